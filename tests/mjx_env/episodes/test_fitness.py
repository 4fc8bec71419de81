import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS, fitness, subgoals_missed, target_misses
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Weights, load_task
from tests.helpers.samples import kinematic_walk

TASK = load_task("stack3")


def value(task=TASK, *, distance=0.0, subgoals_missed=0, nodes=3, ending=Ending.SUCCESS):
    arrays = dict(distance=np.float32, subgoals_missed=np.int32, nodes=np.int32, ending=np.int8)
    given = dict(distance=distance, subgoals_missed=subgoals_missed, nodes=nodes, ending=ending)
    return float(fitness(task, **{name: np.array([given[name]], kind) for name, kind in arrays.items()})[0])


@given(
    st.floats(0, 10, width=32),
    st.integers(0, 3),
    st.integers(1, 250),
    st.sampled_from([Ending.SUCCESS, Ending.FAILURE, Ending.TIMEOUT]),
)
def test_equation_1_of_the_paper(distance, missed, nodes, ending):
    expected = -(
        1000 * distance + 10 * nodes + 30 * (ending == Ending.TIMEOUT) + 50 * (ending == Ending.FAILURE) + 500 * missed
    )
    assert value(distance=distance, subgoals_missed=missed, nodes=nodes, ending=ending) == pytest.approx(
        expected, rel=1e-5
    )


def test_weights_come_from_the_task():
    weights = Weights(distance=1.0, node=2.0, timeout=3.0, failure=4.0, subgoal=5.0)
    task = dataclasses.replace(TASK, weights=weights)
    assert value(task, distance=10, nodes=10, subgoals_missed=2, ending=Ending.FAILURE) == -(10 + 20 + 10 + 4)
    assert value(task, ending=Ending.TIMEOUT) == -(6 + 3)


def test_nothing_is_worse_than_broken_physics():
    assert value(ending=Ending.BROKEN, distance=np.nan) == WORST_FITNESS
    assert value(distance=100, nodes=250, subgoals_missed=5, ending=Ending.FAILURE) > WORST_FITNESS


def test_distances_are_zero_at_the_targets():
    world = sample_layouts(TASK, 0, 4)
    poses = world.poses.copy()
    poses[:, 0, :3] = world.kits[:, 0] + np.float32([0, 0, 0.052])
    poses[:, 1, :3] = poses[:, 0, :3] + np.float32([0, 0, 0.1])
    poses[:, 2, :3] = poses[:, 1, :3] + np.float32([0.3, 0.4, 0.1])
    found = target_misses(TASK, dataclasses.replace(world, poses=poses)).distance
    np.testing.assert_allclose(found, np.tile([0, 0, 0.5], (4, 1)), atol=1e-6)


def test_targets_turn_with_their_frames():
    world = sample_layouts(TASK, 0, 1)
    poses = world.poses.copy()
    poses[0, 0] = (0, 0, 0.8, np.sqrt(0.5), np.sqrt(0.5), 0, 0)  # a quarter about x: its z is the world's -y
    poses[0, 1, :3] = (0, -0.1, 0.8)
    assert target_misses(TASK, dataclasses.replace(world, poses=poses)).distance[0, 1] == pytest.approx(0, abs=1e-6)


def test_subgoals_are_counted():
    _, world, _ = kinematic_walk("restack", seed=5, count=20, steps=8, subgoal_reward="seen")
    missed = subgoals_missed(world)
    np.testing.assert_array_equal(missed, 1 - world.reached[:, 0].astype(int))
    assert set(missed) == {0, 1}
    assert (subgoals_missed(sample_layouts(TASK, 0, 3)) == 0).all()
