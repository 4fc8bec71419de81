"""Episodes in which things go wrong: the table, the rollout and the playback of one fate are the same episode."""

import dataclasses
import functools

import numpy as np
import pytest

from bt_jax._util.statistics import wilson
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.mjx_env.episodes.adaptive import AdaptiveEvaluator
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import nothing_wrong, sample_episodes, sample_fates
from bt_jax.mjx_env.faults.variants import bit
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import Faults, load_task, with_faults
from bt_jax.tasks.faults import FAULTS, PRESETS
from tests.helpers.samples import PARTS, random_trees

LAYOUTS, DRAWS = 4, 3


class Case:
    """A few trees of the genes of a task, one of which does it, layouts and fates."""

    def __init__(self, task_name, faults):
        self.task = with_faults(load_task(task_name), faults)
        pool = gene_pool(self.task)
        self.semantics = LeafSemantics(self.task, pool)
        self.trees = random_trees(0, pool.leaves, 12, most_leaves=6)
        self.encoded = encode_all(self.trees, pool, 64)
        self.fates = sample_fates(self.task, 5, layouts=LAYOUTS, draws=DRAWS)
        self.layouts = take(sample_layouts(self.task, 5, LAYOUTS), np.repeat(np.arange(LAYOUTS), DRAWS))
        self.table = TableEvaluator(self.semantics, Kinematic(self.task), batch=len(self.trees))

    def episodes(self, fates=None):
        return self.table(self.encoded, self.layouts, fates=fates)


case = functools.cache(Case)
HARSH = PRESETS["harsh"]
MUCH = Faults(0.3, 0.2, 0.1, 0.01, 5.0, hide=0.1, move=0.1, take=0.1, heavy=0.3)


@pytest.mark.parametrize(
    ("task_name", "trees", "rows"),
    [("stack3", (1, 5, 8), (0, 4, 11)), pytest.param(PARTS, (2, 9), (3, 7), marks=pytest.mark.slow)],
)
def test_a_playback_is_the_episode_of_the_table(task_name, trees, rows):
    one = case(task_name, MUCH)
    found, settler = one.episodes(one.fates), Settler(one.task, Kinematic(one.task))
    for p in trees:
        for k in rows:
            row = slice(k, k + 1)
            played = play(one.semantics, settler, one.trees[p], take(one.layouts, row), one.fates[row])
            assert (played.ending, len(played.ticks)) == (found.ending[p, k], found.ticks[p, k])
            assert played.struck == found.struck[p, k]
            np.testing.assert_allclose(played.misses.distance, found.misses.distance[p, k], atol=1e-5)


@pytest.mark.parametrize("task_name", ["stack3"])
def test_a_rollout_is_the_episode_of_the_table(task_name):
    one = case(task_name, MUCH)
    rollout = RolloutEvaluator(one.semantics, Kinematic(one.task), batch=len(one.trees))
    ours, theirs = one.episodes(one.fates), rollout(one.encoded, one.layouts, fates=one.fates)
    np.testing.assert_array_equal(ours.ending, theirs.ending)
    np.testing.assert_array_equal(ours.ticks, theirs.ticks)
    np.testing.assert_allclose(ours.values, theirs.values, atol=0.5)


def test_a_table_of_which_little_comes_again_is_given_up_without_a_change_of_results(monkeypatch):
    one = case("stack3", MUCH)
    monkeypatch.setattr("bt_jax.mjx_env.episodes.adaptive.TRIED", 1)
    monkeypatch.setattr("bt_jax.mjx_env.episodes.adaptive.LEAST_HITS", 1.0)
    table = TableEvaluator(one.semantics, Kinematic(one.task), batch=len(one.trees))
    adaptive = AdaptiveEvaluator(table, Kinematic(one.task))
    first = adaptive(one.encoded, one.layouts, fates=one.fates)
    assert adaptive.rolls_out
    assert 0 < table.hit_rate < 1
    second, known = adaptive(one.encoded, one.layouts, fates=one.fates), table.num_followed
    np.testing.assert_array_equal(first.values, second.values)
    np.testing.assert_array_equal(first.struck, second.struck)
    assert table.num_followed == known


def test_gaussian_errors_succeed_as_often_as_the_draws_of_the_table():
    task = with_faults(load_task("stack"), Faults(drop=0.1, place_spread=0.02, turn_spread=3.0))
    task = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=12))  # for one try more
    pool, count = gene_pool(task), 60
    tree = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
    semantics, encoded = LeafSemantics(task, pool), encode_all([tree], pool, 16)
    layouts, fates = sample_episodes(task, 3, layouts=count, draws=2)
    gaussian = sample_fates(task, 3, layouts=count, draws=2, continuous=True)
    table = TableEvaluator(semantics, Kinematic(task), batch=1)(encoded, layouts, fates=fates)
    rollout = RolloutEvaluator(semantics, Kinematic(task), batch=1)(encoded, layouts, fates=gaussian)
    assert 0.3 < table.solved.mean() < 1
    low, high = wilson(int(table.solved.sum()), table.solved.size)
    assert low <= rollout.solved.mean() <= high
    assert (table.misses.distance != rollout.misses.distance).any()


def test_every_fault_happens_in_the_episodes():
    struck = np.bitwise_or.reduce(case("stack3", MUCH).episodes(case("stack3", MUCH).fates).struck, axis=None)
    assert {name for name in FAULTS if struck & bit(name)} == set(FAULTS)


def test_without_a_fate_nothing_goes_wrong():
    one = case("stack3", HARSH)
    plain, none = one.episodes(), one.episodes(nothing_wrong(one.task, LAYOUTS * DRAWS))
    np.testing.assert_array_equal(plain.values, none.values)
    assert not plain.struck.any()
    assert len(np.unique(plain.values.reshape(len(one.trees), LAYOUTS, DRAWS), axis=2)[0, 0]) == 1


def test_episodes_follow_their_fates_however_they_are_batched():
    one = case("stack3", MUCH)
    together, rng = one.episodes(one.fates), np.random.default_rng(0)
    which = rng.integers(0, LAYOUTS * DRAWS, (len(one.trees), 5)).astype(np.int32)
    alone = TableEvaluator(one.semantics, Kinematic(one.task), batch=5, memory=0)
    some = alone(one.encoded, one.layouts, which, one.fates)
    assert alone.table.num_restarts > 0
    np.testing.assert_array_equal(some.values, np.take_along_axis(together.values, which, axis=1))
    np.testing.assert_array_equal(some.struck, np.take_along_axis(together.struck, which, axis=1))


TOLD = {
    "slip": "slips out of the gripper",
    "drop": "drops on the way",
    "jam": "the gripper does not",
    "misplace": "mm off",
    "hide": "gets out of sight",
    "move": "a person moves",
    "take": "a person",
}


@pytest.mark.parametrize("fault", TOLD)
def test_what_went_wrong_is_told(fault):
    one = case("stack3", MUCH)
    p, k = np.argwhere(one.episodes(one.fates).struck & bit(fault))[0]
    row = slice(k, k + 1)
    settler = Settler(one.task, Kinematic(one.task))
    played = play(one.semantics, settler, one.trees[p], take(one.layouts, row), one.fates[row])
    assert any(TOLD[fault] in words for tick in played.ticks for words in tick.troubles)
