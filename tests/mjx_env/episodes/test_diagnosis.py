import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.diagnosis import explain_failure
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Target, load_task

IN_KIT = "move(YellowBox, (0, 0, 0.055), KittingBox)"
ON_YELLOW = "move(GreenBox, (0, 0, 0.1), YellowBox)"


def playback(task, text, layout=None):
    tree = parse_tree(text)
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    return play(
        semantics, Settler(task, Kinematic(task)), tree, sample_layouts(task, 0, 1) if layout is None else layout
    )


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("stack", f"Sequence({IN_KIT}, gripper(open))", "GreenBox is never put anywhere"),
        ("stack", f"Sequence({IN_KIT}, pick(GreenBox))", "GreenBox is still in the gripper"),
        ("stack", f"Sequence({ON_YELLOW}, {IN_KIT})", "GreenBox stands on YellowBox and is not taken away"),
        ("restack", IN_KIT, "BlueBox stands on YellowBox and is not taken away"),
        (
            "stack",
            f"Sequence({IN_KIT}, move(GreenBox, (0.133, 0, 0.055), KittingBox))",
            "GreenBox is put somewhere else",
        ),
        (
            "stack",
            "move(YellowBox, (0.3, 0, 0.3), KittingBox)",
            "nothing is under the place where YellowBox should be put",
        ),
        (
            "stack",
            f"Sequence(move(GreenBox, (0, 0, 0.055), KittingBox), {IN_KIT})",
            "GreenBox is where YellowBox should be put",
        ),
        (
            "stack",
            f"Sequence({IN_KIT}, {ON_YELLOW}, gripper(closed))",
            "everything is in its place, but the tree fails",
        ),
        (
            "stack",
            f"Sequence({IN_KIT}, {ON_YELLOW}, close_gripper, open_gripper)",
            "everything is in its place, but the tree does not succeed in time",
        ),
    ],
)
def test_what_kept_the_first_missed_target_from_being_met(name, text, reason):
    task = load_task(name)
    assert explain_failure(task, playback(task, text)) == reason


def test_the_kit_may_stand_where_something_was_demonstrated():
    """A place in the robot's frame, on the wall of a kit that stands on that table, fails; on a free table it does not."""
    task = load_task("stack")
    wall = (-1 - task.kit.size[0] / 2, 0, task.tables[0].top + 0.05)
    target = Target("BlueBox", tuple(np.subtract(wall, task.robot_position).tolist()), task.robot_frame)
    task = dataclasses.replace(task, targets=(target,))
    text = f"move(BlueBox, ({', '.join(f'{x:.3f}' for x in target.position)}), {task.robot_frame})"
    for table, solved in (("TableLeft", False), ("TableRight", True)):
        fixed = dataclasses.replace(task, layout=dataclasses.replace(task.layout, kit=table))
        found = playback(fixed, text, sample_layouts(fixed, 3, 1))
        assert found.solved == solved
        if not solved:
            assert explain_failure(fixed, found) == "the kit is where BlueBox should be put"


def test_a_box_may_slip_from_its_place_or_lie_on_the_floor():
    task = load_task("stack")
    edge = "move(YellowBox, (0.4, 0, 0.05), KittingBox)"  # half of the box is over the edge of the table
    assert explain_failure(task, playback(task, edge)) == "YellowBox does not stay on TableRight where it is put"


def test_a_simulation_that_diverged_is_named():
    task = load_task("stack")
    found = playback(task, ON_YELLOW)
    broken = dataclasses.replace(found, ending=Ending.BROKEN, solved=False)
    assert explain_failure(task, broken) == "the simulation diverged"
