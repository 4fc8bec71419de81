"""What is learnt of leaves: what they achieve, in which order they work, and which of them nobody has tried."""

import itertools
from collections import Counter

import jax
import numpy as np
import pytest

from bt_jax.behaviors import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.status import Status
from bt_jax.encoding.tick import NOTED
from bt_jax.gp.achievements.compose import compose, leaf_parts
from bt_jax.gp.achievements.goals import Goals, Measured
from bt_jax.gp.achievements.linkage import Linkage
from tests.helpers.tower import Tower

TOWER = Tower()
GOALS = TOWER.goals
TOKENS = {leaf.name: TOWER.vocabulary.token(leaf) for leaf in TOWER.vocabulary.leaves}
RIGHT = [TOKENS[name] for name in ("0@4", "1@1", "2@3")]


def learnt(*rows):
    trees, fits = compose(leaf_parts(np.array(rows, np.int32), 8))
    assert fits.all()
    measured = TOWER.measured(Trees(trees.tokens[None], trees.sizes[None]))
    one = jax.tree.map(lambda leaf: leaf[0], measured)
    return Linkage.empty(GOALS).updated(trees, one, GOALS)


def test_a_leaf_is_known_for_what_it_achieves():
    linkage = learnt(RIGHT, [TOKENS["0@4"], TOKENS["1@2"], TOKENS["2@3"]])
    assert linkage.achieves[RIGHT].tolist() == [[2, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert linkage.achieves.sum() == 4
    assert linkage.known().all()
    assert linkage.tested[TOKENS["2@3"]] == 2  # also where it failed


@pytest.mark.parametrize("order", [*itertools.permutations(range(3))])
def test_leaves_are_sorted_as_has_worked(order):
    wrong = [list(row) for row in itertools.permutations(RIGHT) if list(row) != RIGHT]
    linkage = learnt(RIGHT, *wrong)
    rng = np.random.default_rng(0)
    given = np.array([[RIGHT[i] for i in order] + [0]] * 500, np.int32)
    found = Counter(map(tuple, linkage.in_order(rng, given).tolist()))
    (best, often), *others = found.most_common()
    assert best == (*RIGHT, 0)
    assert often > 2 * max(count for _, count in others)
    assert all(row[-1] == 0 for row in found)


def test_without_experience_every_order_is_possible():
    rng = np.random.default_rng(0)
    found = Linkage.empty(GOALS).in_order(rng, np.array([RIGHT] * 200, np.int32))
    assert {tuple(row) for row in found.tolist()} == set(itertools.permutations(RIGHT))


def test_the_least_tested_come_first_and_each_as_often_as_the_others():
    rng = np.random.default_rng(0)
    linkage = learnt(RIGHT)
    assert linkage.untested(GOALS) is False  # a leaf is known for every target
    drawn = linkage.least_tested(rng, np.arange(3, dtype=np.int32), GOALS, 5)
    assert not np.isin(drawn, RIGHT).any()
    assert all(len(set(column)) == 5 for column in drawn.T.tolist())
    assert (GOALS.group[drawn] == np.arange(3)).all()


def test_donors_are_what_is_known_or_what_is_not_tested():
    rng = np.random.default_rng(0)
    linkage = learnt(RIGHT)
    assert set(linkage.donors(rng, 1, GOALS, np.zeros(20, bool)).tolist()) == {RIGHT[1]}
    curious = linkage.donors(rng, 1, GOALS, np.ones(20, bool))
    assert (GOALS.group[curious] == 1).all()
    assert RIGHT[1] in curious.tolist()  # in its turn
    assert len(set(curious.tolist())) == TOWER.places


def test_a_baseline_is_expected_to_achieve_what_its_leaves_concern_until_episodes_say_otherwise():
    rng = np.random.default_rng(0)
    wrong = [TOKENS[name] for name in ("2@0", "0@4", "1@5")]
    linkage = Linkage.empty(GOALS, jax.tree.map(lambda leaf: leaf[0], compose(leaf_parts(np.array([wrong]), 8))[0]))
    assert [linkage.donors(rng, a, GOALS, np.zeros(9, bool)).tolist() for a in (2, 0, 1)] == [[t] * 9 for t in wrong]
    found = Counter(map(tuple, linkage.in_order(rng, np.array([sorted(wrong)] * 500, np.int32)).tolist()))
    assert found.most_common(1)[0][0] == tuple(wrong)
    assert not linkage.known().any()
    assert linkage.untested(GOALS)


def test_a_leaf_that_tells_of_a_step_is_known_for_it():
    rng = np.random.default_rng(0)
    goals = Goals(GOALS.group, np.array([*GOALS.concerns, -1], np.int32), np.array([*GOALS.guard, 0], np.int32))
    trees, _ = compose(leaf_parts(np.array([[TOKENS["unlock"], RIGHT[0]]] * 2), 8))
    trace = np.where(trees.tokens >= 3, 1 << Status.SUCCESS, 0).astype(np.uint8)
    achieved = np.array([[1, 0, 0, 1], [1, 0, 0, 0]], np.float32)
    linkage = Linkage.empty(goals)
    assert linkage.step_leaves(rng, 3, 5) is None
    trace[trees.tokens == TOKENS["unlock"]] |= NOTED
    measured = Measured(np.zeros(2, np.float32), np.zeros(2, np.float32), achieved, 1 - achieved, trace)
    linkage = linkage.updated(trees, measured, goals)
    assert linkage.step_leaves(rng, 3, 5).tolist() == [TOKENS["unlock"]] * 5
    assert linkage.achieves[:, 3].sum() == 1


@pytest.mark.parametrize(("wanted", "credited"), [(1, [0, 0, 1]), (2, [0, 1, 1])])
def test_of_leaves_that_move_the_same_the_last_has_done_it(wanted, credited):
    """As many of the last as there are achievements for the group."""
    leaves = [TOKENS[name] for name in ("0@1", "0@2", "0@4")]
    goals = Goals(GOALS.group, np.zeros(wanted, np.int32), np.zeros(wanted, np.int32))
    trees, _ = compose(leaf_parts(np.array([leaves]), 8))
    trace = np.where(trees.tokens >= 3, 1 << Status.SUCCESS, 0).astype(np.uint8)
    achieved = np.ones((1, wanted), np.float32)
    measured = Measured(np.zeros(1, np.float32), np.ones(1, np.float32), achieved, 1 - achieved, trace)
    linkage = Linkage.empty(goals).updated(trees, measured, goals)
    assert linkage.achieves[leaves, 0].tolist() == credited


def test_pairs_of_many_leaves_take_the_memory_of_those_that_were_met():
    """16 groups of 350 leaves and 1000 trees; a table of all pairs would take 250 MB."""
    groups, each = 16, 350
    group = np.concatenate([np.full(FIRST_LEAF, -1), np.repeat(np.arange(groups), each)]).astype(np.int32)
    goals = Goals(group, np.arange(groups, dtype=np.int32), np.zeros(groups, np.int32))
    rng = np.random.default_rng(0)
    leaves = FIRST_LEAF + rng.permuted(np.arange(groups) * each + rng.integers(each, size=(1000, groups)), axis=1)
    trees, _ = compose(leaf_parts(leaves, 32))
    trace = np.where(trees.tokens >= FIRST_LEAF, 1 << Status.SUCCESS, 0).astype(np.uint8)
    nothing = np.zeros((1000, groups), np.float32)
    measured = Measured(np.zeros(1000, np.float32), np.zeros(1000, np.float32), nothing, nothing, trace)
    linkage = Linkage.empty(goals).updated(trees, measured, goals)
    assert linkage.pairs.stood.sum() == 1000 * groups * (groups - 1) / 2
    assert sum(leaf.nbytes for leaf in jax.tree.leaves(linkage)) < 4 << 20
