import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.commands.replay import replay
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.render.offscreen import available
from bt_jax.tasks import Faults, load_task, with_faults
from tests.helpers.six_axis import SIX_AXIS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(available() is not True, reason=f"the twin's camera needs a renderer: {available()}"),
]
PERFECT = Realism.perfect()
STACK = """Sequence
  move(YellowBox, (0, 0, 0.022), KittingBox)
  move(GreenBox, (0, 0, 0.04), YellowBox)
  move(BlueBox, (0, 0, 0.04), GreenBox)"""


def test_the_twin_stacks_three_boxes_though_a_person_interferes_and_its_log_replays(tmp_path):
    log = tmp_path / "twin.jsonl"
    run = run_twin(
        YUMI, Program(load_task("yumi_stack"), parse_tree(STACK)), 0, disturbances=1, log=log, realism=Realism.perfect()
    )
    assert run.exit_code == Exit.DONE
    assert run.solved
    assert max(run.distances) < 0.005
    assert len(run.touches) >= 1
    assert list(read_log(log))[-1]["exit_code"] == Exit.DONE
    assert all(tick.same for tick in replay(log))


def test_the_twin_does_again_what_faults_undo_and_no_setpoint_leaves_the_limits(tmp_path):
    """Fingers often slip, jam and drop; in this draw they slip once. The log says of attempts what was provoked."""
    task, log = load_task("yumi_stack"), tmp_path / "faults.jsonl"
    task = dataclasses.replace(task, targets=task.targets[:1])
    task = with_faults(task, Faults(slip=0.3, drop=0.3, jam=0.2, place_spread=0.004))
    program = Program(task, parse_tree("move(YellowBox, (0, 0, 0.022), KittingBox)"))
    run = run_twin(YUMI, program, 0, log=log, realism=PERFECT, draw=7)
    assert run.exit_code == Exit.DONE, run.outcome.reason
    assert run.counters.rejected == 0
    entries = list(read_log(log))
    provoked = [entry["what"] for entry in entries if entry["kind"] == "disturbance" and entry["what"] != "misplace"]
    noticed = [entry["fault"] for entry in entries if entry.get("fault")]
    assert provoked == noticed
    assert provoked
    for arm in YUMI.arms:
        setpoints = [row for entry in entries if entry.get("arm") == arm.name for row in entry["setpoint"]]
        assert np.all(np.array(setpoints) >= arm.lower - 1e-5)
        assert np.all(np.array(setpoints) <= arm.upper + 1e-5)


def test_a_box_is_handed_over_where_no_arm_reaches_both_ends():
    """Tables so far apart that the box is the right arm's and the kit the left one's: it goes by the middle table."""
    task = load_task("yumi_stack")
    apart = [
        dataclasses.replace(table, position=(table.position[0], 1.75 * table.position[1], table.position[2]))
        for table in task.tables
    ]
    task = dataclasses.replace(
        task, tables=tuple(apart), layout=dataclasses.replace(task.layout, kit="TableLeft"), targets=task.targets[:1]
    )
    hands: dict[str, None] = {}

    def look(moment):
        if moment.shown.seen.holding == "YellowBox":
            hands.update(dict.fromkeys(arm for arm, gap in moment.shown.seen.opening.items() if gap < 0.045))

    run = run_twin(
        YUMI,
        Program(task, parse_tree("move(YellowBox, (0, 0, 0.022), KittingBox)")),
        1,
        on_tick=look,
        realism=Realism.perfect(),
    )
    assert run.exit_code == Exit.DONE
    assert run.solved
    assert list(hands) == ["right", "left"]


def test_another_robot_has_the_twin_for_free():
    """One arm of six joints, by EGM without an external axis."""
    task = dataclasses.replace(load_task("yumi_stack"), targets=load_task("yumi_stack").targets[:1])
    program = Program(task, parse_tree("move(YellowBox, (0, 0, 0.022), KittingBox)"))
    run = run_twin(SIX_AXIS, program, 0, realism=PERFECT)
    assert run.exit_code == Exit.DONE, run.outcome.reason
    assert run.solved
    assert max(run.distances) < 0.005
