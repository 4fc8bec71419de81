import dataclasses
import itertools

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import fixed_layout, free_layout, kit_table, kit_tables, move_kit, put
from bt_jax.app.state.extents import heading
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.predicates import reachable
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import load_task, task_from_dict
from tests.helpers.trays import TRAYS

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
    return np.add(START.kits[0, 0], (x, y, TASK.kits[0].thickness / 2 + HALF + z))


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
        (tuple(kit(TASK.kits[0].inner[0])), "kit's wall"),
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


def test_the_start_of_objects_that_lie_turned_is_kept():
    world = sample_layouts(TRAYS, 0, 1)
    physics = MujocoPhysics(TRAYS, threads=1)
    plate = TRAYS.object_names.index("Plate")
    turned = put(TRAYS, physics, world, "Plate", world.poses[0, plate, :3].astype(float), 70.0)
    assert heading(turned.poses[0, plate]) == pytest.approx(70, abs=0.2)
    aside = put(TRAYS, physics, turned, "Plate", np.add(turned.poses[0, plate, :3], (0.02, 0, 0)))
    assert heading(aside.poses[0, plate]) == pytest.approx(70, abs=0.2)  # as it lay
    task = fixed_layout(TRAYS, turned)
    assert [place.turn for place in task.layout.fixed] == [None, pytest.approx(70, abs=0.2), *[None] * 4]
    again = sample_layouts(task_from_dict(task.to_dict(), source="dict"), 5, 1)
    np.testing.assert_allclose(again.poses, turned.poses, atol=2e-3)


def test_what_fits_a_place_only_when_it_is_turned():
    world = sample_layouts(TRAYS, 0, 1)
    physics = MujocoPhysics(TRAYS, threads=1)
    wall = np.add(world.kits[0, 0], (0.2, 0, 0.0125))  # 0.045 m beside the wall of TrayA
    with pytest.raises(UserError, match="inside TrayA's wall"):
        put(TRAYS, physics, world, "Plate", wall, 0.0)
    after = put(TRAYS, physics, world, "Plate", wall, 90.0)
    np.testing.assert_allclose(after.poses[0, 1, :3], wall, atol=2e-3)


def test_what_stands_on_nothing_level_topples():
    world = sample_layouts(TRAYS, 0, 1)
    cube = world.poses[0, 0, :3].astype(float)
    with pytest.raises(UserError, match=r"topples over|slides off"):
        put(TRAYS, MujocoPhysics(TRAYS, threads=1), world, "Can", np.add(cube, (0.045, 0, 0.08)))


def test_kits_with_a_table_of_their_own_stay_there():
    kits = (dataclasses.replace(TRAYS.kits[0], table="TableLeft"), TRAYS.kits[1])
    close = dataclasses.replace(TRAYS.layout, spacing=0.1, margin=0.1)
    task = dataclasses.replace(TRAYS, kits=kits, layout=close)
    world = sample_layouts(task, 0, 1)
    assert kit_tables(TRAYS) == [table.name for table in TRAYS.tables]
    assert (kit_tables(task), kit_table(task, world)) == (["TableMiddle", "TableRight"], "TableMiddle")
    moved = move_kit(task, world, "TableRight")
    np.testing.assert_array_equal(moved.kits[0, 0], world.kits[0, 0])
    np.testing.assert_allclose(moved.kits[0, 1] - world.kits[0, 1], [1, 0, 0], atol=1e-6)
    both = dataclasses.replace(task, kits=(kits[0], dataclasses.replace(kits[1], table="TableRight")))
    assert kit_tables(both) == []


def test_an_object_may_be_put_where_a_robot_that_drives_does_not_reach_now():
    task = load_task("mobile_stack")
    world = sample_layouts(task, 0, 1)
    index, (near, far) = (
        task.object_names.index("BlueBox"),
        [np.add(t.position, (0, 0.2, 0.43)) for t in task.tables[:2]],
    )
    physics = MujocoPhysics(task, threads=1)
    beside = dataclasses.replace(world, base=np.array([[near[0], 0.675]], np.float32))
    beside = put(task, physics, beside, "BlueBox", near)
    assert reachable(beside, task)[0, index]
    after = put(task, physics, beside, "BlueBox", far)
    assert not reachable(after, task)[0, index]
    np.testing.assert_allclose(after.poses[0, index, :2], far[:2], atol=2e-3)
