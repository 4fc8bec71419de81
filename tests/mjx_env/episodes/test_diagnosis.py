import dataclasses
import math

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
from tests.helpers.samples import PARTS

IN_KIT = "move(YellowBox, (0, 0, 0.055), KittingBox)"
ON_YELLOW = "move(GreenBox, (0, 0, 0.1), YellowBox)"

FETCHED = "Fallback(holding(YellowBox), Sequence(Fallback(reachable(YellowBox), approach(YellowBox)), pick(YellowBox)))"


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
        ("mobile_stack", "pick(YellowBox)", "YellowBox is out of reach: nothing approaches it"),
        (
            "mobile_stack",
            f"Sequence({FETCHED}, place(YellowBox, (0, 0, 0.052), KittingBox))",
            "the place of YellowBox is out of reach: nothing approaches it",
        ),
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
    wall = (-1 - task.kits[0].size[0] / 2, 0, task.tables[0].top + 0.05)
    target = Target("BlueBox", tuple(np.subtract(wall, task.robot_position).tolist()), task.robot_frame)
    task = dataclasses.replace(task, targets=(target,))
    text = f"move(BlueBox, ({', '.join(f'{x:.3f}' for x in target.position)}), {task.robot_frame})"
    for table, solved in (("TableLeft", False), ("TableRight", True)):
        fixed = dataclasses.replace(task, layout=dataclasses.replace(task.layout, kit=table))
        found = playback(fixed, text, sample_layouts(fixed, 3, 1))
        assert found.solved == solved
        if not solved:
            assert explain_failure(fixed, found) == "the walls of the kit are where BlueBox should be put"


def test_a_box_may_slip_from_its_place_or_lie_on_the_floor():
    task = load_task("stack")
    edge = "move(YellowBox, (0.4, 0, 0.05), KittingBox)"  # half of the box is over the edge of the table
    assert explain_failure(task, playback(task, edge)) == "YellowBox does not stay on TableRight where it is put"


def test_a_simulation_that_diverged_is_named():
    task = load_task("stack")
    found = playback(task, ON_YELLOW)
    broken = dataclasses.replace(found, ending=Ending.BROKEN, solved=False)
    assert explain_failure(task, broken) == "the simulation diverged"


KIT = load_task(PARTS)
BAR, BOLT1, BOLT2 = KIT.targets[1:4]
PUT_BOLT = "move(Bolt, (0.05, -0.05, 0.0275), TrayA)"
TOPPLED = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)


def turned(degrees):
    return (math.cos(math.radians(degrees) / 2), 0.0, 0.0, math.sin(math.radians(degrees) / 2))


def arranged(places):
    """A layout with some objects at other places [m, from the middle of TableRight's top or a tray] and turns (wxyz)."""
    layout = sample_layouts(KIT, 0, 1)
    poses = layout.poses.copy()
    origins = {"TableRight": (1.0, 0.0, 0.75), "TrayA": layout.kits[0, 0], "TrayB": layout.kits[0, 1]}
    for i, thing in enumerate(KIT.objects):
        poses[0, i, :3] = (1 - 0.24 + 0.16 * (i % 4), 0.25 - 0.16 * (i // 4), 0.75 + thing.height / 2)
        poses[0, i, 3:] = turned(0)
    for name, (origin, x, y, *turn) in places.items():
        i = KIT.object_names.index(name)
        height = KIT.objects[i].size[0] if turn == [TOPPLED] else KIT.objects[i].height
        poses[0, i] = (*np.add(origins[origin], (x, y, height / 2)), *(turn[0] if turn else turned(0)))
    return dataclasses.replace(layout, poses=poses.astype(np.float32))


@pytest.mark.parametrize(
    ("targets", "places", "text", "reason"),
    [
        ([BOLT1], {}, "holding(Bolt)", "no Bolt is put in TrayA.a2"),
        ([BOLT1], {}, "pick(Bolt)", "Bolt1 is still in the gripper"),
        (
            [BOLT1],
            {f"Bolt{i}": ("TableRight", 0.1, -0.1 * i, TOPPLED) for i in (1, 2, 3)},
            PUT_BOLT,
            "no Bolt is left to take: Bolt1 has toppled",
        ),
        (
            [Target("Bolt", (0.0, 0.0, 0.1), "Cube")],
            {f"Bolt{i}": ("TrayA", -0.13, 0.04 * i - 0.08) for i in (1, 2, 3)},
            PUT_BOLT,
            "no Bolt is left to take: the fingers have no room beside Bolt1: TrayA and Bolt2 are too near",
        ),
        ([Target("Can", (0.0, 0.0, 0.04), "TrayA")], {"Can": ("TableRight", 0, -0.2, TOPPLED)}, PUT_BOLT, "Can has toppled"),
        (
            [KIT.targets[0]],
            {"Plate": ("TableRight", 0.0, -0.2), "Can": ("TableRight", 0.0, -0.15)},
            "pick(Plate)",
            "the fingers have no room beside Plate: Can is too near, and it is too wide for the gripper the other way",
        ),
        (
            [BAR],
            {"Bar1": ("TrayA", -0.08, 0.0, turned(45))},
            "holding(Bar)",
            "Bar1 is in its place, but turned by 45 degrees from how it should lie",
        ),
        ([BOLT1], {"Cube": ("TrayA", 0.05, -0.05)}, "holding(Bolt)", "Cube is in TrayA.a2, where Bolt should be put"),
        (
            [Target("Can", (0.0, 0.0, 0.0425), "TrayA")],
            {},
            "move(Can, (0.07, 0, 0.0425), TrayB)",
            "Can stands in TrayB instead of TrayA",
        ),
        (  # along the tray's edge it would fit
            [Target("Plate", (0.07, 0.06, 0.0125), "TrayB")],
            {"Plate": ("TableRight", 0.0, -0.2, turned(45))},
            "move(Plate, (0.07, 0.06, 0.0125), TrayB)",
            "the walls of TrayB are where Plate should be put",
        ),
        ([BOLT1, BOLT2], {}, PUT_BOLT, "no Bolt is put in TrayA.a3"),
    ],
)  # fmt: skip
def test_why_parts_turned_objects_and_trays_are_missed(targets, places, text, reason):
    task = dataclasses.replace(KIT, targets=tuple(targets))
    assert explain_failure(task, playback(task, text, arranged(places))) == reason
