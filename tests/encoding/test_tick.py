import jax
import jax.numpy as jnp
import numpy as np
import pytest
from py_trees.common import Status as Theirs

from bt_jax.behaviors import Behavior, Control, Vocabulary
from bt_jax.encoding.arrays import encode, encode_all
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.tick import Status, jump_table, tick_trees
from bt_jax.encoding.walk import prefix
from tests.helpers.samples import random_trees
from tests.helpers.strategies import ATOMS, GENES

LEAVES = (*ATOMS, *GENES)
VOCABULARY = Vocabulary.of(LEAVES)
TO_THEIRS = {Status.SUCCESS: Theirs.SUCCESS, Status.FAILURE: Theirs.FAILURE, Status.RUNNING: Theirs.RUNNING}


@jax.jit
def tick_all(trees, statuses):
    """Each tree with its own row of statuses [P, V]."""
    rows = jnp.arange(statuses.shape[0])
    return tick_trees(jump_table(trees), lambda token: statuses[rows, token], trace=True)


def agree_with_py_trees(trees, num_nodes, seed):
    rng = np.random.default_rng(seed)
    shares = rng.dirichlet((1, 1, 0.5), len(trees))  # some trees meet mostly successes, others mostly failures
    draws = rng.random((len(trees), len(VOCABULARY), 1))
    statuses = (draws > np.cumsum(shares, axis=1)[:, None, :2]).sum(axis=-1).astype(np.int8)
    ticked = jax.device_get(tick_all(encode_all(trees, VOCABULARY, num_nodes), statuses))
    roots = []
    for i, tree in enumerate(trees):
        seen: list[Behavior] = []

        def status_of(leaf, row=statuses[i], seen=seen):
            seen.append(leaf)
            return TO_THEIRS[Status(row[VOCABULARY.token(leaf)])]

        root = to_py_trees(tree, status_of)
        root.tick_once()
        nodes = prefix(tree)
        assert root.status == TO_THEIRS[Status(ticked.status[i])]
        assert seen == [nodes[j] for j in np.flatnonzero(ticked.visited[i])]
        if ticked.status[i] == Status.RUNNING:
            assert nodes[ticked.leaf[i]] == seen[-1]
        else:
            assert ticked.leaf[i] == num_nodes + (ticked.status[i] == Status.FAILURE)
        roots.append(int(ticked.status[i]))
    assert set(roots) == set(Status)


def test_ticks_as_py_trees_does():
    agree_with_py_trees(random_trees(1, LEAVES, 2000, most_leaves=8), 64, seed=2)


@pytest.mark.slow
@pytest.mark.parametrize(("num_nodes", "most_leaves", "count"), [(64, 14, 2000), (MAX_NODES, 60, 400)])
def test_ticks_as_py_trees_does_on_many_trees(num_nodes, most_leaves, count):
    trees = [t for t in random_trees(3, LEAVES, count + 200, most_leaves=most_leaves) if len(prefix(t)) <= num_nodes]
    assert len(trees) >= count
    agree_with_py_trees(trees, num_nodes, seed=4)


def test_a_full_array_and_the_deepest_tree():
    num_nodes = MAX_NODES
    wide = Control.sequence(*(LEAVES[i % len(LEAVES)] for i in range(num_nodes - 1)))
    deep = LEAVES[0]
    for i in range((num_nodes - 1) // 2):
        deep = (Control.sequence if i % 2 else Control.fallback)(LEAVES[i % len(LEAVES)], deep)
    agree_with_py_trees([wide, deep] * 40, num_nodes, seed=5)


def test_a_table_of_few_trees_serves_many_episodes():
    a, b = Behavior("open_gripper"), Behavior("pick", ("YellowBox",))
    table = jump_table(encode_all([Control.sequence(a, b), Control.fallback(a, b)], VOCABULARY, 8))
    tree = jnp.array([1, 0, 0, 1], jnp.int32)
    success = jnp.array([True, True, False, False])

    def status_of(token):
        first = token == VOCABULARY.token(a)
        return jnp.where(first, success.astype(jnp.int8), jnp.int8(Status.RUNNING))

    ticked = tick_trees(table, status_of, tree=tree)
    assert list(ticked.status) == [Status.SUCCESS, Status.RUNNING, Status.FAILURE, Status.RUNNING]
    assert list(ticked.leaf) == [8, 2, 9, 2]
    assert ticked.visited is None


def test_the_padding_of_a_batch_changes_nothing():
    trees = random_trees(6, LEAVES, 30, most_leaves=5)
    trees = [tree for tree in trees if len(prefix(tree)) <= 16]
    small, large = (jump_table(encode_all(trees, VOCABULARY, n)) for n in (16, 40))
    alone = jump_table(jax.tree.map(lambda leaf: leaf[None], encode(trees[3], VOCABULARY, 16)))
    assert (alone.words[0] == small.words[3]).all()
    assert (small.first == large.first).all()
