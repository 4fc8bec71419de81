import dataclasses
import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from bt_jax.behaviors.geometry import is_at, turn_error
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS, fitness, subgoals_missed, target_misses
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.predicates import in_own_target
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import poses_by_name
from bt_jax.tasks import Target, Weights, load_task
from tests.helpers.random_states import jittered, random_world, swapped
from tests.helpers.samples import MIXED, PARTS, assert_same, kinematic_walk

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


def brute_force(task, world):
    """The least cost and the most targets that can be met at once, over all ways to give each target an object."""
    poses, held = poses_by_name(world, task), int(world.held[0])
    in_hand = task.object_names[held] if held >= 0 else None

    def cost(target, name):
        one, pose, frame = task.thing(name), poses[name], poses[target.frame]
        away = math.dist(pose.position, frame.apply(target.position))
        turned = 0.0 if target.turn is None else abs(turn_error(one, pose, frame, target.turn))
        return task.weights.distance * away + task.weights.turn * turned

    def meets(target, name):
        place = task.thing(name), poses[name], poses[target.frame], target.position
        return name != in_hand and is_at(*place, turn=target.turn, episode=task.episode)

    names = [[one for one in task.instances[t.object] if one != t.frame] for t in task.targets]
    ways = [way for way in itertools.product(*names) if len(set(way)) == len(way)]
    costs = [sum(map(cost, task.targets, way)) for way in ways]
    return min(costs), max(sum(map(meets, task.targets, way)) for way in ways)


@pytest.mark.parametrize("name", [PARTS, MIXED], ids=lambda name: Path(name).stem)
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_instances_are_assigned_as_the_best_of_all_ways(name, seed):
    task, rng = load_task(name), np.random.default_rng(seed)
    world = random_world(rng, task)
    cost, most_met = brute_force(task, world)
    assume(brute_force(task, jittered(world, rng))[1] == most_met)  # away from limits: the simulation has 32 bits
    found = target_misses(task, world)
    weights = task.weights
    assert (weights.distance * found.distance + weights.turn * found.turn).sum() == pytest.approx(cost, rel=1e-4)
    assert found.met.sum() == most_met
    for i, target in enumerate(task.targets):
        assert found.turn[0, i] == 0 or target.turn is not None
    shuffled = swapped(
        world, rng, [np.array([task.object_names.index(o) for o in own]) for own in task.instances.values()]
    )
    assert_same(target_misses(task, shuffled), found)


def in_a_row(*, slots, bolts, height=0.06):
    """A task with slots for bolts and the state in which bolts stand at `bolts` [x, z], all in metres."""
    task = load_task("bolts")
    bolt = next(thing for thing in task.objects if thing.part)
    bolt = dataclasses.replace(bolt, size=(*bolt.size[:2], height))
    task = dataclasses.replace(
        task,
        objects=tuple(dataclasses.replace(bolt, name=f"Bolt{i + 1}") for i in range(len(bolts))),
        targets=tuple(Target(bolt.part, (x, 0.0, z), task.kits[0].name) for x, z in slots),
    )
    world = sample_layouts(load_task("bolts"), 0, 1)
    poses = np.zeros((1, len(bolts), 7), np.float32)
    poses[0, :, :3] = world.kits[0, 0] + np.array([[x, 0.0, z] for x, z in bolts])
    poses[..., 3] = 1
    return task, dataclasses.replace(world, poses=poses)


def test_a_slot_that_is_filled_is_met_whatever_else_costs_as_little():
    row = [(0.1 * i, 0.03) for i in range(2)]
    for off in (-0.002, 0.0, 0.002):
        for bolts in ([(0.1 + off, 0.03), (0.2, 0.03)], [(0.2, 0.03), (0.1 + off, 0.03)]):
            found = target_misses(*in_a_row(slots=row, bolts=bolts))
            np.testing.assert_array_equal(found.met, [[False, True]])
            assert found.distance.sum() == pytest.approx(0.2 + off, abs=1e-6), "the least sum"


def test_one_flat_part_does_not_meet_two_targets():
    task, world = in_a_row(slots=[(0.0, 0.004), (0.0, 0.008)], bolts=[(0.0, 0.006), (0.3, 0.002)], height=0.004)
    assert task.episode.tolerance > 0.002
    assert target_misses(task, world).met.sum() == 1


def test_spare_parts_cost_nothing_and_filled_slots_count_at_the_start():
    slots = [(0.0, 0.03), (0.1, 0.03)]
    task, world = in_a_row(slots=slots, bolts=[(0.3, 0.03), (0.1, 0.03), (5.0, 0.03), (0.0, 0.03)])
    found = target_misses(task, world)
    assert found.met.all()
    np.testing.assert_allclose(found.distance, 0, atol=1e-6)
    np.testing.assert_array_equal(in_own_target(world, task), [[False, True, False, True]])


def test_an_instance_that_a_target_names_is_not_counted_for_its_part():
    task, world = in_a_row(slots=[(0.0, 0.03), (0.1, 0.03)], bolts=[(0.0, 0.03), (0.5, 0.03)])
    named = dataclasses.replace(task.targets[1], object="Bolt1")
    found = target_misses(dataclasses.replace(task, targets=(task.targets[0], named)), world)
    np.testing.assert_allclose(found.distance, [[0.5, 0.1]], atol=1e-6, err_msg="Bolt2 to the slot in which Bolt1 is")
