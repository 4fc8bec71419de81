import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.skills import Released
from bt_jax.mjx_env.world import snap
from bt_jax.tasks import load_task
from tests.helpers.samples import MIXED, assert_same, semantics_of, walk

TASK = load_task("stack3")


def let_go(positions, *, box=0, kit=(0.0, 0.0, 0.7525)):
    """Releases of one box, the three boxes being at `positions` [S, 3, 3]."""
    positions = np.asarray(positions, np.float32)
    count = len(positions)
    world = sample_layouts(TASK, 0, count)
    poses = np.concatenate([positions, world.poses[..., 3:]], axis=-1)
    world = dataclasses.replace(world, poses=poses, kits=np.tile(np.float32(kit), (count, 1, 1)))
    return Released(world, poses, np.ones((count, 3), bool), np.full(count, box, np.int32))


def locality(task_name, *, seed, count, steps):
    """Share of random releases whose reduced problem ends within 1 mm of the whole scene, and the largest deviation."""
    semantics = semantics_of(task_name, atoms=False)
    physics = MujocoPhysics(semantics.task)
    _, released = walk(semantics, physics, seed=seed, count=count, steps=steps)
    whole = physics.settle(released.world.kits, released.poses, released.present & (released.box >= 0)[:, None])
    settler = Settler(semantics.task, physics)
    poses, ok = settler.settle(released)
    assert ok.all()
    assert settler.asked <= len(ok)
    assert settler.solved < 1.2 * settler.asked  # those whose neighbourhood was too small are solved twice
    deviation = np.linalg.norm(poses[..., :3] - whole.poses[..., :3], axis=-1).max(axis=-1)
    return (deviation < 1e-3).mean(), deviation.max()


def test_neighbourhoods_decide():
    share, _ = locality("stack3", seed=0, count=30, steps=8)
    assert share >= 0.98


def test_neighbourhoods_decide_among_unequal_objects_in_two_trays():
    share, _ = locality(MIXED, seed=0, count=30, steps=8)
    assert share >= 0.98


@settings(max_examples=3)
@given(st.integers(0, 2**31 - 1))
def test_unequal_objects_settle_in_their_neighbourhood_as_in_the_whole_scene(seed):
    semantics = semantics_of(MIXED, atoms=False)
    physics = Kinematic(semantics.task)
    _, released = walk(semantics, physics, seed=seed, count=8, steps=8)
    whole = physics.settle(released.world.kits, released.poses, released.present & (released.box >= 0)[:, None])
    poses, _ = Settler(semantics.task, physics).settle(released)
    # Snapping may take away what just carried an object.
    assert (np.abs(poses[..., :3] - whole.poses[..., :3]).max(axis=(1, 2)) < 1e-3).mean() > 0.97


@pytest.mark.slow
@pytest.mark.parametrize("task_name", ["stack", "pyramid", "restack", "yumi_stack"])
def test_neighbourhoods_decide_in_every_task(task_name):
    share, _ = locality(task_name, seed=1, count=150, steps=10)
    assert share >= 0.98


def test_equal_problems_are_solved_once():
    settler = Settler(TASK, MujocoPhysics(TASK, threads=1))
    near, far = [-1.0, 0.1, 0.83], [1.2, 0.1, 0.8]
    first = let_go([[near, [-1.0, 0.1, 0.9], far]])
    rest, _ = settler.settle(first)
    assert settler.solved == 1
    swapped = let_go([[near, far, [-1.0, 0.1, 0.9]]])
    other_table = let_go([[[1.0, 0.1, 0.83], [1.0, 0.1, 0.9], [-0.8, 0.2, 0.8]]])
    again = [settler.settle(released)[0] for released in (first, swapped, other_table)]
    assert settler.solved == 1
    assert settler.asked == 4
    np.testing.assert_array_equal(again[0], rest)
    np.testing.assert_array_equal(again[1][0, [0, 2, 1]], rest[0])
    np.testing.assert_allclose(again[2][0, :2, :3] - [2, 0, 0], rest[0, :2, :3], atol=1e-6)


def test_solutions_that_do_not_fit_are_simulated_again():
    released = let_go([[[-1.0, 0.1, 0.83 + i / 100], [1.2, 0.1, 0.8], [1.2, 0.3, 0.8]] for i in range(6)])
    physics = MujocoPhysics(TASK, threads=1)
    expected, small = Settler(TASK, physics).settle(released), Settler(TASK, physics, memory=3000)
    for i in (0, 1, 2, 3, 4, 5, 0, 5):
        one = jax.tree.map(lambda leaf, i=i: leaf[i : i + 1], released)
        assert_same(small.settle(one), jax.tree.map(lambda leaf, i=i: leaf[i : i + 1], expected))
    assert 6 < small.solved < small.asked
    assert_same(small.settle(released), expected)


def test_different_problems_are_not_confused():
    settler = Settler(TASK, MujocoPhysics(TASK, threads=1))
    far = [1.2, 0.1, 0.8]
    alone, beside = [-1.0, 0.1, 0.83], [-1.0, 0.21, 0.8]
    settler.settle(let_go([[alone, far, [1.2, 0.3, 0.8]], [alone, beside, far]]))
    assert settler.solved == 2
    settler.settle(let_go([[alone, far, [1.2, 0.3, 0.8]]], kit=(-1.0, 0.0, 0.7525)))
    assert settler.solved == 3


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_places_off_the_tables_count_too(seed):
    """Wherever a box is let go, also above the floor, the reduced problem ends as the whole scene does."""
    rng = np.random.default_rng(seed)
    positions = rng.uniform((-2.5, -1, 0.05), (2.5, 1, 1.2), (8, 3, 3))
    released = let_go(positions)
    physics = Kinematic(TASK)
    settled = physics.settle(released.world.kits, released.poses, released.present)
    released = dataclasses.replace(released, poses=settled.poses)
    poses = settled.poses.copy()
    poses[:, 0, :3] = rng.uniform((-2.5, -1, 0.05), (2.5, 1, 1.2), (8, 3))
    poses = snap(poses)  # else a box whose middle is over an edge may stay in one and fall in the other
    released = dataclasses.replace(released, poses=poses)
    whole = physics.settle(released.world.kits, poses, released.present)
    found, ok = Settler(TASK, physics).settle(released)
    assert ok.all()
    np.testing.assert_allclose(found[..., :3], whole.poses[..., :3], atol=1e-3)


def test_a_solution_that_is_no_number_is_not_ok():
    class Broken(Kinematic):
        def settle(self, kit, poses, present):
            settled = super().settle(kit, poses, present)
            bad = poses[:, 0, 2] > 1
            return dataclasses.replace(settled, poses=np.where(bad[:, None, None], np.nan, settled.poses), ok=~bad)

    settler = Settler(TASK, Broken(TASK))
    rest = [[1.0, 0.2, 0.8], [1.0, -0.2, 0.8]]
    released = let_go([[[-1, 0, 2], *rest], [[-1, 0, 0.9], *rest]])
    for _ in range(2):
        poses, ok = settler.settle(released)
        assert_same(ok, np.array([False, True]))
        assert np.isfinite(poses[1]).all()
