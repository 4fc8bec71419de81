"""The transition table and the plain rollout are two ways to the same episodes."""

import dataclasses
import functools

import jax
import numpy as np
import pytest

from bt_jax.behaviors import FIRST_LEAF, Behavior, Control
from bt_jax.encoding.arrays import encode_all
from bt_jax.mjx_env.episodes.codes import NOT_COMPUTED
from bt_jax.mjx_env.episodes.evaluator import MANY, TableEvaluator
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS
from bt_jax.mjx_env.episodes.pages import PAGE, UNKNOWN
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.episodes.table import MEMORY, Known, TableFullError, TransitionTable
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task
from tests.helpers.samples import PARTS, SometimesBroken, assert_same, followed, mixed_trees, semantics_of

NODES, BATCH, LAYOUTS = 32, 100, 3


@functools.cache
def table_evaluator(task_name, subgoal_reward=None):
    semantics = semantics_of(task_name, subgoal_reward=subgoal_reward)
    return TableEvaluator(semantics, Kinematic(semantics.task), batch=BATCH)


def both_agree(task_name, count, layouts, subgoal_reward=None):
    semantics = semantics_of(task_name, subgoal_reward=subgoal_reward)
    trees, starts = mixed_trees(semantics, 10, count, NODES), sample_layouts(semantics.task, 5, layouts)
    by_table = table_evaluator(task_name, subgoal_reward)(trees, starts)
    by_rollout = RolloutEvaluator(semantics, Kinematic(semantics.task), batch=BATCH)(trees, starts)
    assert_same(by_table, by_rollout)
    assert by_table.values.shape == (count, layouts)
    assert set(by_table.ending.ravel()) == {Ending.SUCCESS, Ending.FAILURE, Ending.TIMEOUT}
    assert by_table.ticks.max() == semantics.task.episode.max_ticks
    return by_table


def test_the_table_and_the_rollout_agree():
    both_agree("restack", BATCH, LAYOUTS)


@pytest.mark.slow
@pytest.mark.parametrize("task_name", [PARTS, "bolts", "fixture"])
def test_the_table_and_the_rollout_agree_on_parts_and_turns(task_name):
    """But for the last digit of sines and cosines, which may decide to which side something falls."""
    semantics = semantics_of(task_name)
    trees, starts = mixed_trees(semantics, 10, BATCH, NODES), sample_layouts(semantics.task, 5, 2)
    by_table = table_evaluator(task_name)(trees, starts)
    by_rollout = RolloutEvaluator(semantics, Kinematic(semantics.task), batch=BATCH)(trees, starts)
    same = (by_table.ending == by_rollout.ending) & (by_table.misses.met == by_rollout.misses.met).all(axis=-1)
    assert np.mean(same & (np.abs(by_table.values - by_rollout.values) < 1)) > 0.99
    assert by_table.misses.met.any(axis=(0, 1)).sum() >= len(semantics.task.targets) / 2


@pytest.mark.slow
def test_the_table_and_the_rollout_agree_on_both_rules_for_subgoals():
    ticked, seen = (both_agree("restack", 5 * BATCH, 4, rule) for rule in ("ticked", "seen"))
    assert (ticked.subgoals_missed >= seen.subgoals_missed).all()
    assert (ticked.subgoals_missed > seen.subgoals_missed).any()


@pytest.mark.slow
@pytest.mark.parametrize("task_name", ["mobile_stack", "pyramid", "restack", "stack", "stack3", "yumi_stack"])
def test_the_table_and_the_rollout_agree_on_many_trees(task_name):
    both_agree(task_name, 5 * BATCH, 4)


def test_the_order_in_which_trees_are_met_does_not_matter():
    semantics = semantics_of("stack3")
    evaluator = table_evaluator("stack3")
    trees, starts = mixed_trees(semantics, 20, BATCH, NODES), sample_layouts(semantics.task, 6, LAYOUTS)
    forward = evaluator(trees, starts)
    fresh = TableEvaluator(semantics, Kinematic(semantics.task), batch=BATCH)
    order = np.random.default_rng(0).permutation(BATCH)
    shuffled = fresh(jax.tree.map(lambda leaf: leaf[order], trees), take(starts, slice(None, None, -1)))
    for ours, theirs in zip(jax.tree.leaves(forward), jax.tree.leaves(shuffled), strict=True):
        np.testing.assert_array_equal(theirs[:, ::-1], ours[order])
    assert_same(evaluator(trees, starts), forward)


def test_those_that_wait_go_on_by_themselves():
    semantics = semantics_of("stack3")
    trees, layouts = mixed_trees(semantics, 30, 2 * MANY, NODES), sample_layouts(semantics.task, 8, 1)
    together, apart = (
        TableEvaluator(semantics, Kinematic(semantics.task), batch=batch)(trees, layouts)
        for batch in (2 * MANY, MANY // 2)
    )
    assert_same(together, apart)


def test_physics_gives_the_same_whatever_was_asked_before():
    semantics = semantics_of("stack3")
    trees, starts = mixed_trees(semantics, 30, BATCH, NODES), sample_layouts(semantics.task, 7, 1)
    one, other = (TableEvaluator(semantics, MujocoPhysics(semantics.task), batch=BATCH) for _ in range(2))
    other(mixed_trees(semantics, 40, BATCH, NODES), starts)
    assert_same(one(trees, starts), other(trees, starts))


def test_rows_of_layouts_can_be_chosen():
    semantics = semantics_of("stack3")
    evaluator = table_evaluator("stack3")
    trees, starts = mixed_trees(semantics, 20, BATCH, NODES), sample_layouts(semantics.task, 6, LAYOUTS)
    whole = evaluator(trees, starts)
    which = np.random.default_rng(1).integers(0, LAYOUTS, (BATCH, LAYOUTS)).astype(np.int32)
    chosen = evaluator(trees, starts, which)
    np.testing.assert_array_equal(chosen.values, np.take_along_axis(whole.values, which, axis=1))
    few = jax.tree.map(lambda leaf: leaf[:7], trees)
    np.testing.assert_array_equal(evaluator(few, starts).values, whole.values[:7])


def test_a_tree_of_two_genes_stacks():
    semantics = semantics_of("stack")
    genes = (
        Behavior("move", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox")),
        Behavior("move", ("GreenBox", (0.0, 0.0, 0.1), "YellowBox")),
    )
    tree = encode_all([Control.sequence(*genes)], semantics.vocabulary, NODES)
    found = table_evaluator("stack")(tree, sample_layouts(semantics.task, 8, LAYOUTS))
    assert found.solved.all()
    assert (found.ending == Ending.SUCCESS).all()
    assert (found.fitness > -35).all()
    assert (found.ticks == 6).all()  # pick and place, twice, then two ticks of success


def test_states_get_one_id_each():
    semantics = semantics_of("stack3")
    table = TransitionTable(semantics, Kinematic(semantics.task))
    starts = sample_layouts(semantics.task, 9, 100)
    twice = take(starts, np.r_[np.arange(100), np.arange(100)])
    np.testing.assert_array_equal(table.ids(twice), np.r_[np.arange(100), np.arange(100)])
    assert table.num_states == 100
    assert_same(table.worlds(np.arange(100, dtype=np.int32)), starts)
    np.testing.assert_array_equal(all_outcomes(table, 100), semantics.outcomes(starts))


def all_outcomes(table, states):
    """What every leaf returns in the first states [2, S, V]."""
    state, token = np.indices((states, len(table.semantics.vocabulary)), np.int32).reshape(2, -1)
    found = jax.jit(Known.outcomes)(table.known, state, token)
    return np.stack(found).reshape(2, states, -1)


def test_the_table_grows():
    semantics = semantics_of("stack3", atoms=False)
    table = TransitionTable(semantics, Kinematic(semantics.task))
    starts = sample_layouts(semantics.task, 10, 3000)
    small = table.nbytes
    place = np.full(100, 2, np.int32)
    for part in (slice(0, 1500), slice(1500, 3000)):
        table.ids(take(starts, part))
        table.learn(np.arange(part.start, part.start + 100, dtype=np.int32), place)
    assert table.num_states == 3200
    assert table.nbytes > small
    first = take(starts, slice(0, 1500))
    np.testing.assert_array_equal(all_outcomes(table, 1500), semantics.outcomes(first))
    assert_same(table.worlds(np.arange(1500, dtype=np.int32)), first)
    every = np.arange(3000, dtype=np.int32)
    known = np.flatnonzero(followed(table, every, np.full(3000, 2, np.int32)) != UNKNOWN)
    np.testing.assert_array_equal(known, np.r_[0:100, 1500:1600])
    assert table.num_transitions == 200


@pytest.mark.parametrize(
    ("task_name", "count", "memory"), [("stack3", 5, 1), ("restack", BATCH, 1), ("stack3", BATCH, 400_000)]
)
def test_a_full_table_begins_again_with_the_same_results(task_name, count, memory):
    """With 1 byte there is room for one episode only."""
    semantics, layouts = semantics_of(task_name), sample_layouts(load_task(task_name), 12, LAYOUTS)
    trees = mixed_trees(semantics, 50, count, NODES)
    make = functools.partial(TableEvaluator, semantics, Kinematic(semantics.task), batch=BATCH, trace=True)
    expected, small = make()(trees, layouts), make(memory=memory)
    for _ in range(2):
        assert_same(small(trees, layouts), expected)
    assert small.table.num_restarts > 0
    assert make().table.num_restarts == 0


@pytest.mark.parametrize(("task_name", "memory"), [("stack3", MEMORY), ("restack", 1)])
def test_leaves_that_no_tree_uses_are_not_computed(task_name, memory, monkeypatch):
    semantics, layouts = semantics_of(task_name), sample_layouts(load_task(task_name), 14, LAYOUTS)
    trees = mixed_trees(semantics, 60, 30, NODES)
    make = functools.partial(TableEvaluator, semantics, Kinematic(semantics.task), batch=10, trace=True)
    expected = make()(trees, layouts)
    monkeypatch.setattr("bt_jax.mjx_env.episodes.table.FEW_TOKENS", 0)
    by_use = make(memory=memory)
    assert_same(by_use(trees[:1], layouts), jax.tree.map(lambda leaf: leaf[:1], expected))
    used = np.isin(np.arange(len(semantics.vocabulary)), [*range(FIRST_LEAF), *trees.tokens[0]])
    computed = all_outcomes(by_use.table, by_use.table.num_states) != NOT_COMPUTED
    np.testing.assert_array_equal(computed, np.broadcast_to(used, computed.shape))
    for _ in range(2):
        assert_same(by_use(trees, layouts), expected)


def test_the_table_is_full_before_an_index_overflows(monkeypatch):
    semantics, most = semantics_of("stack3", atoms=False), 200_000
    monkeypatch.setattr("bt_jax.mjx_env.episodes.pages.MOST_CELLS", most)
    table = TransitionTable(semantics, Kinematic(semantics.task))
    starts = sample_layouts(semantics.task, 13, 1)
    many = jax.tree.map(lambda leaf: np.repeat(leaf, most // PAGE, axis=0), starts)
    moved = np.float32(0.001) * np.arange(most // PAGE, dtype=np.float32)
    many = dataclasses.replace(many, kits=many.kits + moved[:, None, None])
    with pytest.raises(TableFullError):
        table.ids(many)
    assert table.num_states == 0
    table.ids(take(many, slice(most // PAGE - 100)))
    assert max(table.known.following.index.size, table.known.following.pages.size) <= most


def test_the_table_stays_within_its_memory():
    semantics, memory = semantics_of("stack3", atoms=False), 4 << 20
    table = TransitionTable(semantics, Kinematic(semantics.task), memory=memory)
    starts = sample_layouts(semantics.task, 13, 500)
    rng, most = np.random.default_rng(0), 0
    while not table.num_restarts:
        try:
            states = table.ids(starts)
            for _ in range(4):
                table.learn(states, rng.integers(0, 5, len(states)).astype(np.int32))
                states = np.arange(table.num_states - len(states), table.num_states, dtype=np.int32)
            starts = dataclasses.replace(starts, kits=starts.kits + np.float32([0.001, 0, 0]))
        except TableFullError:
            table.forget()
        most = max(most, table.nbytes)
    assert memory / 4 < most < 3 / 4 * memory
    np.testing.assert_array_equal(table.ids(starts), np.arange(500))
    np.testing.assert_array_equal(followed(table, np.arange(500, dtype=np.int32), np.full(500, 2, np.int32)), UNKNOWN)


def test_a_simulation_that_diverges_costs_one_individual_and_no_more():
    semantics = semantics_of("stack")
    into_kit = Behavior("move", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox"))
    onto_box = Behavior("move", ("YellowBox", (0.0, 0.0, 0.1), "GreenBox"))
    trees = encode_all([into_kit, onto_box], semantics.vocabulary, NODES)
    evaluator = TableEvaluator(semantics, SometimesBroken(semantics.task), batch=BATCH)
    starts = sample_layouts(semantics.task, 8, 2)
    for _ in range(2):
        found = evaluator(trees, starts)
        assert (found.ending == [[Ending.BROKEN] * 2, [Ending.SUCCESS] * 2]).all()
        assert found.fitness[0] == WORST_FITNESS
        assert not found.solved[0].any()
        np.testing.assert_array_equal(found.fitness[1:], table_evaluator("stack")(trees, starts).fitness[1:])
        assert np.isfinite(found.misses.distance).all()
    assert evaluator.table.num_broken == 2
