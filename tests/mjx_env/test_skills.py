import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from bt_jax.behaviors import Behavior
from bt_jax.behaviors.geometry import heading, turn_error
from bt_jax.behaviors.pose import Pose
from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.skills import LIFT, act, settled_world
from bt_jax.mjx_env.world import poses_by_name, snap, take
from tests.helpers.samples import PARTS, assert_same, kinematic_walk, random_commands, semantics_of, sized


def command(semantics, *call):
    return semantics.commands.index(Behavior(*call))


@pytest.fixture(scope="module")
def stack():
    semantics, worlds, _ = kinematic_walk("stack3", seed=0, count=60, steps=8)
    return semantics, worlds


def each(semantics, world, index):
    return act(semantics, world, np.full(len(world.held), index, np.int32))


def test_pick_lifts_one_box_and_nothing_else(stack):
    semantics, worlds = stack
    world = take(worlds, (worlds.held < 0) & worlds.gripper_open)
    for box, name in enumerate(semantics.task.object_names):
        released = each(semantics, world, command(semantics, "pick", (name,)))
        lift = np.zeros_like(world.poses)
        lift[:, box, 2] = sized(semantics.task)[box] * LIFT
        np.testing.assert_allclose(released.poses, world.poses + lift, atol=1e-6)
        assert (released.world.held == box).all()
        assert not released.world.gripper_open.any()
        np.testing.assert_array_equal(released.present, np.tile(np.arange(3) != box, (len(world.held), 1)))
        assert (released.box == box).all()


def test_place_goes_to_the_goal_or_onto_what_is_in_the_way(stack):
    semantics, worlds = stack
    world = take(worlds, worlds.held == 0)
    assert len(world.held) > 5
    position = (0.0, 0.0, 0.055)
    released = each(semantics, world, command(semantics, "place", ("YellowBox", position, "KittingBox")))
    goal = world.kits[:, 0] + np.float32(position)
    np.testing.assert_allclose(released.poses[:, 0, :2], goal[:, :2], atol=1e-6)
    np.testing.assert_array_equal(released.poses[:, 0, 3:], world.poses[:, 0, 3:])
    np.testing.assert_array_equal(released.poses[:, 1:], world.poses[:, 1:])
    free = (np.abs(world.poses[:, 1:, :2] - goal[:, None, :2]).max(axis=-1) > 0.1).all(axis=1)
    assert free.any()
    np.testing.assert_allclose(released.poses[free, 0, 2], goal[free, 2], atol=1e-6)
    assert (released.poses[:, 0, 2] >= goal[:, 2] - 1e-6).all()
    assert (released.world.held == -1).all()
    assert released.world.gripper_open.all()
    assert released.present.all()


def test_a_box_in_the_way_carries_the_placed_one():
    semantics = semantics_of("stack3")
    world = sample_layouts(semantics.task, 1, 10)
    for call in (
        ("pick", ("YellowBox",)),
        ("place", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox")),
        ("pick", ("GreenBox",)),
        ("place", ("GreenBox", (0.0, 0.0, 0.055), "KittingBox")),
    ):
        released = each(semantics, world, command(semantics, *call))
        world = settled_world(semantics.task, released, released.poses)
    np.testing.assert_allclose(world.poses[:, 1, 2] - world.poses[:, 0, 2], 0.1, atol=2e-4)


def test_the_gripper_opens_and_closes(stack):
    semantics, worlds = stack
    opened = each(semantics, worlds, command(semantics, "open_gripper"))
    assert opened.world.gripper_open.all()
    assert (opened.world.held == -1).all()
    np.testing.assert_array_equal(opened.box, worlds.held)
    closed = each(semantics, worlds, command(semantics, "close_gripper"))
    assert not closed.world.gripper_open.any()
    np.testing.assert_array_equal(closed.world.held, worlds.held)
    assert (closed.box == -1).all()
    for released in (opened, closed):
        np.testing.assert_array_equal(released.poses, worlds.poses)
        np.testing.assert_array_equal(released.world.kits, worlds.kits)


def test_numpy_and_jax_agree(stack):
    semantics, worlds = stack
    commands = random_commands(semantics, worlds, np.random.default_rng(2))
    host = act(semantics, worlds, commands)
    device = jax.jit(lambda world, command: act(semantics, world, command))(
        jax.tree.map(jnp.asarray, worlds), jnp.asarray(commands)
    )
    assert_same(jax.device_get((device.present, device.box)), (host.present, host.box))
    np.testing.assert_array_equal(snap(np.asarray(device.poses)), snap(host.poses))


@pytest.fixture(scope="module")
def parts():
    semantics, worlds, _ = kinematic_walk(PARTS, seed=0, count=60, steps=8)
    return semantics, worlds


def test_numpy_and_jax_agree_on_parts_and_turns(parts):
    semantics, worlds = parts
    commands = random_commands(semantics, worlds, np.random.default_rng(2))
    names = [semantics.commands[command].name for command in commands]
    assert {"pick", "place"} <= set(names)
    host = act(semantics, worlds, commands)
    device = jax.jit(lambda world, command: act(semantics, world, command))(
        jax.tree.map(jnp.asarray, worlds), jnp.asarray(commands)
    )
    assert_same(jax.device_get((device.present, device.box)), (host.present, host.box))
    np.testing.assert_allclose(device.poses, host.poses, atol=2e-6)


def test_what_is_placed_is_turned_the_shorter_way_if_the_place_says_how_it_lies(parts):
    semantics, worlds = parts
    task, turned = semantics.task, 0
    for index, call in enumerate(semantics.commands):
        held = [task.object_names.index(name) for name in task.instances[call.object]] if call.object else []
        rows = np.flatnonzero(np.isin(worlds.held, held))[:6]
        if call.name != "place" or not rows.size:
            continue
        world = take(worlds, rows)
        released = each(semantics, world, index)
        for s, one in enumerate(world.held):
            thing = task.objects[one]
            before, after = (Pose.of(poses[s, one].tolist()) for poses in (world.poses, released.poses))
            frame = poses_by_name(world, task, s)[call.frame]
            if call.turn is None or not thing.symmetry:
                assert after.quaternion == pytest.approx(before.quaternion, abs=1e-6), call
                continue
            assert turn_error(thing, after, frame, call.turn) == pytest.approx(0, abs=2e-3), (
                call
            )  # of snapped quaternions
            least = abs(turn_error(thing, before, frame, call.turn))
            assert abs(math.remainder(heading(after) - heading(before), 2 * math.pi)) == pytest.approx(least, abs=2e-3)
            turned += least > 0.1
    assert turned > 20


def test_settled_states_are_snapped_and_keep_what_they_have_seen():
    semantics, worlds, _ = kinematic_walk("restack", seed=3, count=30, steps=8)
    released = each(semantics, worlds, command(semantics, "open_gripper"))
    poses = released.poses + np.float32(3e-5)
    world = settled_world(semantics.task, released, poses)
    np.testing.assert_array_equal(world.poses, snap(world.poses))
    np.testing.assert_array_equal(world.reached, worlds.reached | subgoals_by_sight(semantics.task, world))
