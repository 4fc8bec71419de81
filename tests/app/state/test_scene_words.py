"""What people hear who do not see the scene."""

import dataclasses

import numpy as np
import pytest

from bt_jax.app.state.scene_words import gripper_words, object_words, target_words
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task
from tests.helpers.trays import TRAYS

TASK = load_task("stack")
START = sample_layouts(TASK, 0, 1)


def with_box(world, name, position):
    """The world with a box elsewhere."""
    poses = world.poses.copy()
    poses[0, TASK.object_names.index(name), :3] = position
    return dataclasses.replace(world, poses=poses)


def test_boxes_on_a_table_in_the_kit_on_each_other_and_in_the_gripper():
    size = TASK.objects[0].edge
    kit = np.add(START.kits[0, 0], (0, 0, TASK.kits[0].thickness / 2 + size / 2))
    world = with_box(START, "YellowBox", kit)
    world = with_box(world, "GreenBox", np.add(kit, (0, 0, size)))
    said = object_words(TASK, world)
    assert said["YellowBox"].sentence == "YellowBox is in the middle of the kit"
    assert said["GreenBox"].sentence == "GreenBox is on top of YellowBox"
    assert said["BlueBox"].sentence.startswith("BlueBox is on Table")
    assert [said[name].support for name in ("YellowBox", "GreenBox")] == [TASK.kits[0].name, "YellowBox"]
    assert said["BlueBox"].support in {table.name for table in TASK.tables}
    held = dataclasses.replace(world, held=np.array([TASK.object_names.index("BlueBox")], np.int8))
    assert object_words(TASK, held)["BlueBox"].sentence == "BlueBox is in the gripper"
    assert (gripper_words(TASK, world), gripper_words(TASK, held)) == (
        "the gripper is empty",
        "the gripper holds BlueBox",
    )


@pytest.mark.parametrize("there", [False, True])
def test_where_boxes_should_be_and_how_far_they_are_from_there(there):
    size = TASK.objects[0].edge
    kit = np.add(START.kits[0, 0], (0, 0, TASK.kits[0].thickness / 2 + size / 2))
    world = with_box(START, "YellowBox", kit) if there else START
    said = target_words(TASK, world)
    assert len(said) == len(TASK.targets)
    assert said[0].startswith("YellowBox should be in the middle of the kit: it is ")
    assert said[0].endswith("there" if there else "mm away")


def test_slots_turns_parts_and_what_has_toppled():
    world = sample_layouts(TRAYS, 0, 1)
    poses = world.poses.copy()
    tray = world.kits[0, 0]
    poses[0, 1] = (*np.add(tray, (-0.15, 0, 0.0125)), np.sqrt(0.5), 0, 0, np.sqrt(0.5))
    poses[0, 2] = (*np.add(tray, (0.15, 0, 0.0325)), np.sqrt(0.5), np.sqrt(0.5), 0, 0)
    world = dataclasses.replace(world, poses=poses)
    said = object_words(TRAYS, world)
    assert said["Plate"].sentence == "Plate is in slot a1 of TrayA, turned by 90 degrees"
    assert said["Can"].sentence.endswith(", toppled over")
    there = target_words(TRAYS, world)
    assert there[0] == "Plate should be in slot a1 of TrayA: it is there"
    assert there[1].startswith("Can should be in slot a2 of TrayA: it is ")
    assert there[3].startswith("a Bolt should be in slot r1c1 of TrayB: it is ")
    poses[0, 1, 3:] = (1, 0, 0, 0)
    turned = target_words(TRAYS, dataclasses.replace(world, poses=poses))
    assert turned[0] == "Plate should be in slot a1 of TrayA: it is turned by 90 degrees too far"
