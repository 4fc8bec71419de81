"""What people hear who do not see the scene."""

import dataclasses

import numpy as np
import pytest

from bt_jax.app.state.scene_words import box_words, gripper_words, target_words
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task

TASK = load_task("stack")
START = sample_layouts(TASK, 0, 1)


def with_box(world, name, position):
    """The world with a box elsewhere."""
    poses = world.poses.copy()
    poses[0, TASK.object_names.index(name), :3] = position
    return dataclasses.replace(world, poses=poses)


def test_boxes_on_a_table_in_the_kit_on_each_other_and_in_the_gripper():
    size = TASK.objects[0].edge
    kit = np.add(START.kits[0, 0], (0, 0, TASK.kit.thickness / 2 + size / 2))
    world = with_box(START, "YellowBox", kit)
    world = with_box(world, "GreenBox", np.add(kit, (0, 0, size)))
    said = box_words(TASK, world)
    assert said["YellowBox"].sentence == "YellowBox is in the middle of the kit"
    assert said["GreenBox"].sentence == "GreenBox is on top of YellowBox"
    assert said["BlueBox"].sentence.startswith("BlueBox is on Table")
    assert [said[name].support for name in ("YellowBox", "GreenBox")] == [TASK.kit.name, "YellowBox"]
    assert said["BlueBox"].support in {table.name for table in TASK.tables}
    held = dataclasses.replace(world, held=np.array([TASK.object_names.index("BlueBox")], np.int8))
    assert box_words(TASK, held)["BlueBox"].sentence == "BlueBox is in the gripper"
    assert (gripper_words(TASK, world), gripper_words(TASK, held)) == (
        "the gripper is empty",
        "the gripper holds BlueBox",
    )


@pytest.mark.parametrize("there", [False, True])
def test_where_boxes_should_be_and_how_far_they_are_from_there(there):
    size = TASK.objects[0].edge
    kit = np.add(START.kits[0, 0], (0, 0, TASK.kit.thickness / 2 + size / 2))
    world = with_box(START, "YellowBox", kit) if there else START
    said = target_words(TASK, world)
    assert len(said) == len(TASK.targets)
    assert said[0].startswith("YellowBox should be in the middle of the kit: it is ")
    assert said[0].endswith("there" if there else "cm away")
