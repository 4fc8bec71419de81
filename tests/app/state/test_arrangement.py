import dataclasses
import itertools

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import fixed_layout, free_layout, goals, kit_table, move_kit, put, retarget, untarget
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task, task_from_dict

TASK = load_task("stack3")
PHYSICS = MujocoPhysics(TASK, threads=1)
START = sample_layouts(TASK, 0, 1)
TOP = TASK.tables[0].top
HALF = TASK.objects[0].edge / 2


def pose(world, name):
    return world.poses[0, TASK.object_names.index(name)]


def on_table(index, x=0.0, y=0.0, z=0.0):
    return np.add(TASK.tables[index].position, (x, y, TASK.tables[index].size[2] / 2 + HALF + z))


def kit(x=0.0, y=0.0, z=0.0):
    return np.add(START.kits[0, 0], (x, y, TASK.kit.thickness / 2 + HALF + z))


def free_table():
    return next(i for i, table in enumerate(TASK.tables) if table.name != kit_table(TASK, START))


def test_a_box_is_put_and_the_others_stay():
    after = put(TASK, PHYSICS, START, "BlueBox", kit(0.1, 0.05))
    np.testing.assert_allclose(pose(after, "BlueBox")[:3], kit(0.1, 0.05), atol=2e-3)
    np.testing.assert_allclose(after.poses[0, :2], START.poses[0, :2], atol=2e-3)
    assert after.held[0] == -1


def test_what_stood_on_a_box_that_was_taken_falls():
    here = pose(START, "YellowBox")[:3].astype(float)
    stacked = put(TASK, PHYSICS, START, "GreenBox", np.add(here, (0, 0, 2 * HALF)))
    assert pose(stacked, "GreenBox")[2] == pytest.approx(TOP + 3 * HALF, abs=2e-3)
    taken = put(TASK, PHYSICS, stacked, "YellowBox", kit())
    np.testing.assert_allclose(pose(taken, "GreenBox")[:3], here, atol=2e-3)


@pytest.mark.parametrize("rule", ["seen", "ticked"])
def test_a_person_may_unstack_and_the_subgoal_is_seen_unless_a_tree_has_to_tick_it(rule):
    task = dataclasses.replace(load_task("restack"), subgoal_reward=rule)
    world = sample_layouts(task, 0, 1)
    assert not world.reached.any()
    for name, x in (("GreenBox", -0.2), ("BlueBox", 0.2)):
        world = put(
            task, PHYSICS, world, name, on_table([t.name for t in task.tables].index(kit_table(task, world)), x, -0.28)
        )
    assert world.reached.all() == (rule == "seen")


@pytest.mark.parametrize(
    ("position", "says"),
    [
        ((5.0, 0.0, 1.0), "no table there, out of reach"),
        ((0.5, 0.0, TOP + HALF), "no table there"),
        (tuple(on_table(free_table(), z=-0.05)), "inside Table"),
        (tuple(on_table(free_table(), z=3.0)), "too high"),
        (tuple(kit(TASK.kit.inner[0])), "kit's wall"),
        (tuple(kit(z=-0.007)), "kit's wall or floor"),
        ((float("nan"), 0.0, 1.0), "not a number"),
        (tuple(np.add(pose(START, "GreenBox")[:3], (0.05, 0, 0.03))), "inside GreenBox"),
        (tuple(np.add(pose(START, "GreenBox")[:3], (0.07, 0, 0.1))), "slides off"),
    ],
)
def test_where_a_box_cannot_be_put(position, says):
    with pytest.raises(UserError, match=says) as error:
        put(TASK, PHYSICS, START, "BlueBox", np.array(position, float))
    assert "; " in str(error.value)


def test_nothing_may_fall_off_a_table():
    index = free_table()
    overhang = put(TASK, PHYSICS, START, "YellowBox", on_table(index, 0.374, 0.3))
    poses = overhang.poses.copy()
    poses[0, 1, :3] = np.add(on_table(index, 0.374, 0.3), (0.04, 0, 2 * HALF))
    with pytest.raises(UserError, match="GreenBox would fall off the table"):
        put(TASK, PHYSICS, dataclasses.replace(overhang, poses=poses), "YellowBox", kit())


def test_the_box_in_the_gripper_stays_there():
    held = dataclasses.replace(START, held=np.array([2], np.int8))
    with pytest.raises(UserError, match="in the gripper"):
        put(TASK, PHYSICS, held, "BlueBox", kit())
    after = put(TASK, PHYSICS, held, "YellowBox", kit())
    np.testing.assert_array_equal(pose(after, "BlueBox"), pose(START, "BlueBox"))


@pytest.mark.parametrize("table", [table.name for table in TASK.tables])
def test_the_kit_changes_places_with_what_is_on_a_table(table):
    world = put(TASK, PHYSICS, START, "BlueBox", kit(0.1))
    moved = move_kit(TASK, world, table)
    assert kit_table(TASK, moved) == table
    np.testing.assert_allclose(
        pose(moved, "BlueBox")[:3] - moved.kits[0, 0], pose(world, "BlueBox")[:3] - world.kits[0, 0], atol=1e-6
    )
    for a, b in itertools.combinations(range(3), 2):
        assert np.abs(moved.poses[0, a, :3] - moved.poses[0, b, :3]).max() > 2 * HALF
    back = move_kit(TASK, moved, kit_table(TASK, world))
    np.testing.assert_allclose(back.poses, world.poses, atol=1e-6)


def test_goals_follow_each_other():
    where = goals(TASK, START)
    np.testing.assert_allclose(where["GreenBox"] - where["YellowBox"], [0, 0, 0.1], atol=1e-6)
    np.testing.assert_allclose(where["YellowBox"] - START.kits[0, 0], [0, 0, 0.052], atol=1e-6)
    two = retarget(TASK, PHYSICS, START, "YellowBox", kit(0.12))
    moved = goals(two, START)
    np.testing.assert_allclose(moved["BlueBox"] - where["BlueBox"], [0.133, 0, 0], atol=2e-3)  # where the gene is


def test_a_target_is_relative_to_what_carries_it():
    where = goals(TASK, START)
    on_blue = retarget(
        untarget(TASK, "BlueBox"), PHYSICS, START, "YellowBox", np.add(pose(START, "BlueBox")[:3], (0.01, 0, 0.1))
    )
    assert on_blue.targets[0] == dataclasses.replace(TASK.targets[0], position=(0.0, 0.0, 0.1), frame="BlueBox")
    beside = retarget(TASK, PHYSICS, START, "BlueBox", kit(-0.1, 0.01))
    assert beside.targets[2].frame == "KittingBox"
    assert beside.targets[2].position[:2] == (-0.1, 0.01)
    table = retarget(TASK, PHYSICS, START, "BlueBox", on_table(free_table()))
    assert table.targets[2].frame == "base_link"
    np.testing.assert_allclose(goals(table, START)["BlueBox"], on_table(free_table()), atol=2e-3)
    chosen = retarget(TASK, PHYSICS, START, "BlueBox", np.add(where["YellowBox"], (0.12, 0, 0)), "YellowBox")
    assert chosen.targets[2] == dataclasses.replace(TASK.targets[2], position=(0.12, 0.0, 0.0), frame="YellowBox")


@pytest.mark.parametrize(
    ("name", "position", "frame", "says"),
    [
        ("BlueBox", (0.0, 3.0, 1.0), None, "no table there, out of reach"),
        ("BlueBox", tuple(kit(0.05)), None, "inside YellowBox"),
        ("BlueBox", tuple(kit(TASK.kit.inner[0])), None, "kit's wall"),
        ("BlueBox", tuple(on_table(free_table(), z=0.2)), None, "hang in the air, 20 cm"),
        ("BlueBox", tuple(kit(-0.204, -0.176, 0.041)), None, "would not stay there"),
        ("YellowBox", tuple(kit(0.13)), "GreenBox", "circular"),
        ("YellowBox", tuple(kit(0.13)), "YellowBox", "choose another frame"),
        ("RedBox", tuple(kit()), None, "no box 'RedBox'"),
    ],
)
def test_where_no_target_can_be(name, position, frame, says):
    with pytest.raises(UserError, match=says):
        retarget(TASK, PHYSICS, START, name, np.array(position), frame)


def test_the_last_target_stays():
    task = untarget(untarget(TASK, "BlueBox"), "GreenBox")
    with pytest.raises(UserError, match="only target"):
        untarget(task, "YellowBox")


@settings(max_examples=40)
@given(
    st.sampled_from(TASK.object_names),
    st.tuples(st.floats(-1.5, 1.5), st.floats(-0.5, 0.5), st.floats(0.7, 1.3)),
    st.sampled_from([None, *TASK.frames]),
)
def test_whatever_is_accepted_is_a_task_with_that_goal(name, position, frame):
    try:
        task = retarget(TASK, PHYSICS, START, name, np.array(position), frame)
    except UserError:
        return
    assert task_from_dict(yaml.safe_load(yaml.safe_dump(task.to_dict())), source="yaml") == task
    assert np.linalg.norm(goals(task, START)[name] - position) < 0.03


def test_a_layout_can_be_fixed_and_set_free():
    world = put(TASK, PHYSICS, START, "BlueBox", on_table(free_table(), 0.1, 0.2))
    task = fixed_layout(TASK, world)
    again = sample_layouts(task_from_dict(task.to_dict(), source="dict"), 5, 2)
    np.testing.assert_allclose(again.poses, np.tile(world.poses, (2, 1, 1)), atol=2e-4)
    np.testing.assert_allclose(again.kits, np.tile(world.kits, (2, 1, 1)), atol=1e-6)
    assert free_layout(task, TASK).layout == TASK.layout


def test_a_tilted_or_held_box_cannot_be_a_beginning():
    tilted = START.poses.copy()
    tilted[0, 0, 3:] = (np.sqrt(0.5), np.sqrt(0.5), 0, 0)
    with pytest.raises(UserError, match="upright"):
        fixed_layout(TASK, dataclasses.replace(START, poses=tilted))
    with pytest.raises(UserError, match="gripper"):
        fixed_layout(TASK, dataclasses.replace(START, held=np.array([0], np.int8)))
