import dataclasses

import mujoco
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import STRANGER, build_scene
from bt_jax.deploy.twin.disturbances import DISTURBANCES, disturbance
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.render.offscreen import available
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")


def test_an_object_that_the_task_does_not_know_lies_out_of_sight():
    plain, added = build_scene(YUMI, TASK, 0), build_scene(YUMI, TASK, 0, stranger="")
    assert added.model.nq == plain.model.nq + 7
    body = added.model.body(STRANGER).id
    data = mujoco.MjData(added.model)
    mujoco.mj_kinematics(added.model, data)
    assert data.xpos[body][0] == 2.0
    geom = added.model.body_geomadr[body]
    assert added.model.geom_matid[geom] == -1
    assert 2 * added.model.geom_size[geom][0] < TASK.objects[0].edge
    twin = build_scene(YUMI, TASK, 0, stranger="GreenBox").model
    green, other = (twin.geom_matid[twin.body_geomadr[twin.body(name).id]] for name in ("GreenBox", STRANGER))
    assert green == other
    assert np.allclose(added.cell.qpos[: plain.model.nq], plain.cell.qpos), "the same layout"


def test_what_keeps_a_cell_from_being_perfect_is_changed_for_a_disturbance():
    realism = disturbance("gripper-latency").change(Realism())
    assert realism == dataclasses.replace(Realism(), gripper_delay=0.6)
    assert disturbance("steal").change(Realism()) == Realism()
    with pytest.raises(UserError, match="no disturbance 'rain'; choose one of swap"):
        disturbance("rain")
    for each in DISTURBANCES.values():
        each.change(Realism()).check()


@pytest.mark.slow
@pytest.mark.skipif(available() is not True, reason=f"the twin's camera needs a renderer: {available()}")
def test_a_box_that_turns_under_the_descending_hand_stops_the_robot():
    program = Program(TASK, parse_tree("Sequence(pick(YellowBox), pick(GreenBox))"))
    run = run_twin(
        YUMI, program, 0, realism=dataclasses.replace(Realism(), width=640, height=480), disturbance="turn-late"
    )
    assert run.exit_code == Exit.STOPPED
    assert [(touch.what, touch.box) for touch in run.touches] == [("turn-late", "YellowBox")]
    assert "Motion supervision" in run.outcome.reason
    assert "during pick(YellowBox)" in run.outcome.reason
    assert run.start + run.outcome.seconds - run.touches[0].time < 1.0
