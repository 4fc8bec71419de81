"""What a trace shows to do nothing can go: the episode stays the same."""

import jax
import numpy as np
import pytest

from bt_jax.behaviors import FIRST_LEAF
from bt_jax.encoding.arrays import Trees, decode, violations
from bt_jax.gp.achievements.traces import without_idle, without_leaf
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.gp.validity import is_valid
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.scene.layouts import sample_layouts
from tests.helpers.samples import semantics_of
from tests.helpers.tower import Tower

NODES, SIZE = 24, 16


def random_valid(vocabulary, count, *, gene_under_fallback):
    return jax.device_get(
        random_trees(
            jax.random.key(5),
            Alphabet.of(vocabulary),
            count=count,
            num_nodes=NODES,
            nodes=SIZE,
            gene_under_fallback=gene_under_fallback,
        )
    )


def smaller(trees, trace, vocabulary, *, gene_under_fallback=False):
    found = [
        without_idle(trees[i], trace[i], vocabulary.kinds, gene_under_fallback=gene_under_fallback)
        for i in range(len(trace))
    ]
    return Trees(np.stack([tree.tokens for tree in found]), np.stack([tree.sizes for tree in found]))


def test_a_tree_without_one_of_its_leaves_is_tidy():
    tower = Tower()
    trees = random_valid(tower.vocabulary, 30, gene_under_fallback=False)
    for i in range(len(trees.tokens)):
        leaves = np.flatnonzero(trees.tokens[i] >= FIRST_LEAF)
        before = trees.tokens[i][leaves].tolist()
        for k, place in enumerate(leaves.tolist()):
            found = without_leaf(trees[i], place, tower.vocabulary.kinds)
            rest = [] if found is None else found.tokens[found.tokens >= FIRST_LEAF].tolist()
            assert rest == before[:k] + before[k + 1 :] or len(leaves) == 1
            if found is not None:
                broken = violations(decode(found, tower.vocabulary))
                assert not [rule for rule in broken if "children" in rule or "own kind" in rule]


@pytest.mark.parametrize("gene_under_fallback", [False, pytest.param(True, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    "tower", [pytest.param(Tower(), marks=pytest.mark.slow), Tower(step=True)], ids=["plain", "step"]
)
def test_the_episode_stays_the_same(tower, gene_under_fallback):
    trees = random_valid(tower.vocabulary, 60, gene_under_fallback=gene_under_fallback)
    before = tower.measured(trees[None])
    found = smaller(trees, before.trace[0], tower.vocabulary, gene_under_fallback=gene_under_fallback)
    after = tower.measured(found[None])
    removed = trees.sizes[:, 0].astype(int) - found.sizes[:, 0]
    np.testing.assert_array_equal(after.achieved, before.achieved)
    np.testing.assert_array_equal(after.solved, before.solved)
    np.testing.assert_allclose(after.fitness[0], before.fitness[0] + removed)
    assert is_valid(found, Alphabet.of(tower.vocabulary), gene_under_fallback=gene_under_fallback).all()
    assert (removed > 0).sum() > 40
    again = smaller(found, after.trace[0], tower.vocabulary, gene_under_fallback=gene_under_fallback)
    np.testing.assert_array_equal(again.tokens, found.tokens)


@pytest.mark.parametrize("layouts", [pytest.param(1, marks=pytest.mark.slow), 3])
def test_boxes_end_where_they_did(layouts):
    semantics = semantics_of("restack")
    trees = random_valid(semantics.vocabulary, 64, gene_under_fallback=False)
    evaluator = TableEvaluator(semantics, Kinematic(semantics.task), batch=64, trace=True)
    starts = sample_layouts(semantics.task, 2, layouts)
    before = evaluator(trees, starts)
    found = smaller(trees, np.bitwise_or.reduce(before.trace, axis=1), semantics.vocabulary)
    after = evaluator(found, starts)
    np.testing.assert_array_equal(after.misses.distance, before.misses.distance)
    for name in ("ending", "ticks", "reached", "solved"):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    removed = trees.sizes[:, 0].astype(np.float32) - found.sizes[:, 0]
    cost = semantics.task.weights.node * removed[:, None]
    np.testing.assert_allclose(after.values, before.values + cost, atol=1e-2)
    assert (removed > 0).sum() > 32
    for i in range(64):
        assert not violations(decode(found[i], semantics.vocabulary), gene_under_fallback=False)
