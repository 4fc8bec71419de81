import random

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status as PyStatus

from bt_jax.behaviors import Behavior, Control, Kind, Vocabulary
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.tick import Status, jump_table, tick_trees
from bt_jax.encoding.walk import prefix
from tests.helpers.strategies import ATOMS, GENES, trees

LEAVES = (*ATOMS, *GENES)
VOCABULARY = Vocabulary.of(LEAVES)
NODES = 32


def random_tree(rng, size):
    """Any tree of that many nodes, well-formed for evolution or not."""
    if size == 1:
        return rng.choice(LEAVES)
    cuts = sorted(rng.sample(range(1, size - 1), rng.randint(0, min(4, size - 2)))) if size > 2 else []
    parts = [b - a for a, b in zip([0, *cuts], [*cuts, size - 1], strict=True)]
    kind = rng.choice((Kind.SEQUENCE, Kind.FALLBACK))
    return Control(kind, tuple(random_tree(rng, part) for part in parts))


def test_equals_the_compiled_tick():
    rng = random.Random(0)
    forest = [random_tree(rng, rng.randint(1, NODES)) for _ in range(1000)]
    outcome = np.random.default_rng(0).choice(3, p=[0.4, 0.4, 0.2], size=(len(forest), len(VOCABULARY))).astype(np.int8)
    rows, table = jnp.arange(len(forest)), jnp.asarray(outcome)
    ticked = tick_trees(
        jax.jit(jump_table)(encode_all(forest, VOCABULARY, NODES)), lambda token: table[rows, token], trace=True
    )
    status, leaf, visited = (np.asarray(x) for x in (ticked.status, ticked.leaf, ticked.visited))
    for e, tree in enumerate(forest):
        ours = tick_tree(tree, lambda behavior, _, e=e: Status(outcome[e, VOCABULARY.token(behavior)]))
        nodes = prefix(tree)
        ticked_leaves = [i for i, s in enumerate(ours.statuses) if s is not None and isinstance(nodes[i], Behavior)]
        assert ours.status == status[e]
        assert ticked_leaves == np.flatnonzero(visited[e]).tolist()
        assert ours.running == (leaf[e] if status[e] == Status.RUNNING else None)


@given(trees(max_leaves=20), st.data())
def test_every_node_has_the_status_of_py_trees(tree, data):
    nodes = prefix(tree)
    leaves = dict.fromkeys(node for node in nodes if isinstance(node, Behavior))
    table = {leaf: data.draw(st.sampled_from(Status)) for leaf in leaves}
    asked = []

    def status_of(leaf, index):
        assert nodes[index] == leaf
        asked.append(index)
        return table[leaf]

    ours = tick_tree(tree, status_of)
    theirs = to_py_trees(tree, lambda leaf: PyStatus[table[leaf].name])
    theirs.tick_once()
    found = []

    def visit(node):
        found.append(None if node.status == PyStatus.INVALID else Status[node.status.name])
        for child in node.children:
            visit(child)

    visit(theirs)
    assert list(ours.statuses) == found
    assert asked == sorted(set(asked))
