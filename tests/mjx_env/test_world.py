import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.planning.pose_geometry import stood
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import (
    POSITION_GRID,
    World,
    concatenate,
    frames,
    leveled,
    rotate,
    snap,
    take,
    to_world,
    world_keys,
)
from bt_jax.tasks import load_task, with_faults
from bt_jax.tasks.faults import PRESETS
from tests.helpers.samples import assert_same, kinematic_walk

numbers = st.floats(-2, 2, width=32)
seeds = st.integers(0, 2**32 - 1)


def quaternions(rng, count):
    q = rng.normal(size=(count, 4))
    return (q / np.linalg.norm(q, axis=1, keepdims=True)).astype(np.float32)


def random_poses(seed, count=20):
    rng = np.random.default_rng(seed)
    return np.concatenate([rng.uniform(-2, 2, (count, 3)).astype(np.float32), quaternions(rng, count)], axis=1)


@given(seeds)
def test_rotations_are_those_of_mujoco(seed):
    poses = random_poses(seed)
    ours = rotate(poses[:, 3:], poses[:, :3])
    for pose, found in zip(poses.astype(float), ours, strict=True):
        expected = np.zeros(3)
        mujoco.mju_rotVecQuat(expected, pose[:3], pose[3:])
        np.testing.assert_allclose(found, expected, atol=1e-5)
    np.testing.assert_allclose(rotate(jnp.asarray(poses[:, 3:]), jnp.asarray(poses[:, :3])), ours, atol=1e-6)


@given(seeds)
def test_snapping_is_a_projection_onto_a_grid(seed):
    poses = random_poses(seed)
    snapped = snap(poses)
    assert snapped.dtype == np.float32
    np.testing.assert_array_equal(snap(snapped), snapped)
    np.testing.assert_array_equal(jax.jit(snap)(poses), snapped)
    assert np.abs(snapped[:, :3] - poses[:, :3]).max() <= POSITION_GRID / 2 + 1e-6
    assert (snapped[:, 3] >= 0).all()
    mirrored = np.concatenate([poses[:, :3], -poses[:, 3:]], axis=1)
    turned = np.abs(poses[:, 3]) > 1e-3  # a rotation by half a turn keeps its sign
    np.testing.assert_array_equal(snap(mirrored)[turned], snapped[turned])


def test_there_is_no_negative_zero():
    assert not np.signbit(snap(np.array([[-1e-6, 0, 0, -1, 0, 0, 1e-6]], np.float32))).any()


def test_keys_are_equal_where_states_are():
    _, world, _ = kinematic_walk("stack3", seed=0, count=20, steps=6)
    keys = world_keys(world)
    fields = np.concatenate(
        [np.asarray(leaf, np.float64).reshape(len(world.held), -1) for leaf in jax.tree.leaves(world)], axis=1
    )
    same_keys = (keys[:, None] == keys[None]).all(axis=-1)
    same_states = (np.abs(fields[:, None] - fields[None]) < 1e-6).all(axis=-1)
    np.testing.assert_array_equal(same_keys, same_states)
    assert same_keys.sum(axis=1).max() > 1


def test_frames_are_boxes_kit_and_robot():
    semantics, world, _ = kinematic_walk("stack3", seed=1, count=5, steps=3)
    task = semantics.task
    found = frames(world, task)
    assert found.shape == (len(world.held), len(task.frames), 7)
    assert found.dtype == np.float32
    np.testing.assert_array_equal(found[:, :3], world.poses)
    np.testing.assert_array_equal(found[:, 3:4, :3], world.kits)
    np.testing.assert_array_equal(
        found[:, 4, :3], np.broadcast_to(np.float32(task.robot_position), found[:, 4, :3].shape)
    )
    np.testing.assert_array_equal(found[:, 3:, 3:], np.broadcast_to([1, 0, 0, 0], (len(found), 2, 4)))
    as_jax = jax.tree.map(jnp.asarray, world)
    np.testing.assert_array_equal(frames(as_jax, task), found)


@pytest.mark.parametrize("task_name", ["stack3", "kit6"])
def test_where_things_go_wrong_frames_are_level_as_the_robot_sees_them(task_name):
    task = with_faults(load_task(task_name), PRESETS["mild"])
    count = len(task.objects)
    rotations = Rotation.random(300 * count, random_state=0)
    faces = Rotation.from_euler("zxy", np.random.default_rng(1).integers(0, 4, (300 * count, 3)) * 90.0, degrees=True)
    tilt = Rotation.from_euler("zx", np.random.default_rng(2).normal(size=(300 * count, 2)) * (90, 3), degrees=True)
    for rotation in (rotations, tilt * faces):
        quaternions = rotation.as_quat(scalar_first=True).reshape(300, count, 4)
        poses = np.concatenate([np.zeros((300, count, 3)), quaternions], axis=-1).astype(np.float32)
        expected = [
            stood(thing, RigidTransform.from_rotation(Rotation.from_quat(quaternion, scalar_first=True))).rotation
            for row in quaternions
            for thing, quaternion in zip(task.objects, row, strict=True)
        ]
        found = leveled(poses, task)
        off = Rotation.concatenate(expected).inv() * Rotation.from_quat(
            found[..., 3:].reshape(-1, 4), scalar_first=True
        )
        assert off.magnitude().max() < 1e-5
        np.testing.assert_array_equal(leveled(jnp.asarray(poses), task), found)


def test_frames_are_level_only_where_things_go_wrong():
    task = load_task("stack3")
    world = sample_layouts(task, 0, 1)
    world.poses[..., 3:] = [0.5, 0.5, 0.5, 0.5]  # x points where y was, y up
    on_top = np.array([[0, 0, 0.1]], np.float32)
    for of, above in ((task, (0.1, 0, 0)), (with_faults(task, PRESETS["mild"]), (0, 0, 0.1))):
        point = to_world(frames(world, of), np.array([0]), on_top)[0, 0] - world.poses[0, 0, :3]
        np.testing.assert_allclose(point, above, atol=1e-6)


def test_points_move_with_their_frames():
    half_turn = np.array([0, 0, 1, 0, 0, 0, 1], np.float32)  # about z, one metre up
    upright = np.array([5, 0, 0, 1, 0, 0, 0], np.float32)
    points = to_world(np.stack([half_turn, upright])[None], np.array([0, 1]), np.array([[1, 2, 3], [1, 2, 3]]))
    np.testing.assert_allclose(points, [[[-1, -2, 4], [6, 2, 3]]], atol=1e-6)


def test_batches_are_cut_and_joined():
    _, world, _ = kinematic_walk("restack", seed=2, count=4, steps=2)
    again = concatenate([take(world, slice(0, 5)), take(world, slice(5, None))])
    assert_same(again, world)
    assert isinstance(again, World)
