"""Which of several equal parts is where changes nothing, and states that differ by that alone are one."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, geometry
from bt_jax.encoding.arrays import decode, encode_all
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.interchange import in_order, interchangeable
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics, taken_by
from bt_jax.mjx_env.world import poses_by_name
from bt_jax.tasks import Subgoal, Target
from tests.helpers.random_states import random_world, swapped
from tests.helpers.samples import PARTS, assert_same, random_trees, semantics_of

NODES = 24
SEMANTICS = semantics_of(PARTS, atoms=False)
BOLTS, BARS = [4, 5, 6], [7, 8]


@given(st.integers(0, 2**32 - 1))
def test_swapped_parts_come_into_one_order(seed):
    rng = np.random.default_rng(seed)
    groups = interchangeable(SEMANTICS)
    world = random_world(rng, SEMANTICS.task)
    ordered = in_order(world, groups)
    assert_same(in_order(swapped(world, rng, groups), groups), ordered)
    assert_same(in_order(ordered, groups), ordered)
    parts = [thing.part for thing in SEMANTICS.task.objects]
    assert sorted(zip(parts, world.poses[0].tolist(), strict=True)) == sorted(
        zip(parts, ordered.poses[0].tolist(), strict=True)
    )
    if world.held[0] >= 0:
        np.testing.assert_array_equal(ordered.poses[0, ordered.held[0]], world.poses[0, world.held[0]])
    assert (world.held < 0) == (ordered.held < 0)


def test_parts_are_interchangeable_unless_one_of_them_has_a_name():
    task, vocabulary = SEMANTICS.task, SEMANTICS.vocabulary
    assert [group.tolist() for group in interchangeable(SEMANTICS)] == [BOLTS, BARS]
    on_bar = Behavior("move", ("Cube", (0.0, 0.0, 0.04), "Bar2"))
    inside = Behavior("subtask", ("s", Behavior("pick", ("Bolt3",))))
    for leaf, kept in ((on_bar, [BOLTS]), (inside, [BARS])):
        semantics = LeafSemantics(task, vocabulary.extended([leaf]))
        assert [group.tolist() for group in interchangeable(semantics)] == kept
    on_bolt = dataclasses.replace(task, targets=(*task.targets, Target("Can", (0.0, 0.0, 0.065), "Bolt1")))
    assert [group.tolist() for group in interchangeable(LeafSemantics(on_bolt, vocabulary))] == [BARS]
    free = dataclasses.replace(task, subgoals=(Subgoal("free", ("clear(Bar1)",)),))
    assert [group.tolist() for group in interchangeable(LeafSemantics(free, vocabulary))] == [BOLTS]
    things = tuple(dataclasses.replace(thing, density=9.0) if thing.name == "Bar2" else thing for thing in task.objects)
    heavier = dataclasses.replace(task, objects=things)
    assert [group.tolist() for group in interchangeable(LeafSemantics(heavier, vocabulary))] == [BOLTS]


@pytest.mark.parametrize("task_name", ["bolts", PARTS])
def test_swapped_parts_at_the_start_change_no_episode(task_name):
    """Neither in the table nor in plain Python, which keeps apart what the table does not."""
    semantics = semantics_of(task_name, atoms=False)
    rng, count = np.random.default_rng(3), 60
    trees = random_trees(4, semantics.vocabulary.leaves, count, most_leaves=8)
    trees = encode_all(trees, semantics.vocabulary, NODES)
    starts = sample_layouts(semantics.task, 5, 1)
    shuffled = swapped(starts, rng, interchangeable(semantics))
    assert (shuffled.poses != starts.poses).any()
    evaluator, apart = (TableEvaluator(semantics, Kinematic(semantics.task), batch=count) for _ in range(2))
    apart.table.swappable = ()
    found = evaluator(trees, starts)
    assert_same(evaluator(trees, shuffled), found)
    assert_same(apart(trees, starts), found)
    assert_same(apart(trees, shuffled), found)
    assert evaluator.table.num_states < 0.6 * apart.table.num_states
    settler = Settler(semantics.task, Kinematic(semantics.task))
    for i in range(0, count, 6):
        played = play(semantics, settler, decode(trees[i], semantics.vocabulary), shuffled)
        assert (played.fitness, played.solved) == (found.values[i, 0], found.solved[i, 0])
        assert_same(played.misses, jax.tree.map(lambda leaf, i=i: leaf[i, 0], found.misses))


@given(st.sampled_from([(0.1, 0.2), (0.2, 0.1)]), st.sampled_from([-1, 1]), st.permutations(BOLTS))
def test_which_of_two_equally_near_parts_is_taken_does_not_depend_on_their_order(place, side, bolts):
    (x, y), task, world = place, SEMANTICS.task, sample_layouts(SEMANTICS.task, 0, 1)
    assert task.robot_position[0] == 0
    poses = world.poses.copy()
    poses[0, :, 1] -= 5.0
    poses[0, bolts[:2], :2] = [[side * x, y], [-side * x, y]]
    world = dataclasses.replace(world, poses=poses)
    pick = np.array([SEMANTICS.names.index("Bolt")], np.int32)
    for batch in (world, jax.tree.map(jnp.asarray, world)):
        assert taken_by(SEMANTICS, batch, pick)[0] == bolts[0 if side < 0 else 1]
    one = geometry.taken_by(task, poses_by_name(world, task), "Bolt")
    assert one == task.object_names[bolts[0 if side < 0 else 1]]
