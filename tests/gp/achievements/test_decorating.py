"""Decorators are taken off and put back, and where they stand evolves, always in valid trees."""

import functools

import jax
import numpy as np
import pytest

from bt_jax.behaviors import FIRST_LEAF, Control, Decorator, ExtendedNode, Kind, Symbol, Vocabulary
from bt_jax.encoding.arrays import decode, encode, violations
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from bt_jax.gp.achievements.decorating import bare, decorated, decoration_of, hardened
from bt_jax.gp.achievements.traces import without_idle
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees

NODES = 24
DECORATORS = (Decorator(Kind.RETRY, 2), Decorator(Kind.RETRY, 5), Decorator(Kind.TIMEOUT, 3))
VOCABULARY = Vocabulary.of(
    [*(Symbol(f"see{i}", Kind.CONDITION) for i in range(2)), *(Symbol(f"do{i}", Kind.ACTION) for i in range(5))],
    DECORATORS,
)
KINDS, V = VOCABULARY.kinds, len(VOCABULARY)
FAILING = np.linspace(0, 1, V).astype(np.float32)
LOOKS = np.zeros((V, 2), np.int32)
LOOKS[VOCABULARY.token(Symbol("do1", Kind.ACTION))] = 0, VOCABULARY.token(Symbol("do0", Kind.ACTION))


def plain_trees(count):
    trees = random_trees(
        jax.random.key(3), Alphabet.of(VOCABULARY), count=count, num_nodes=NODES, nodes=9, gene_under_fallback=True
    )
    return jax.device_get(trees)


def harden(tree, rng):
    return hardened(rng, tree, FAILING, LOOKS, KINDS, gene_under_fallback=True)


@functools.cache
def hard_trees():
    """Random trees that were hardened several times."""
    rng, trees = np.random.default_rng(0), plain_trees(40)
    found = []
    for row in range(40):
        tree = trees[row]
        for _ in range(5):
            tree = harden(tree, rng) or tree
        found.append(tree)
    return found


def test_hardened_trees_are_valid_and_differ_in_one_thing():
    seen = set()
    rng = np.random.default_rng(1)
    for tree in hard_trees():
        root = decode(tree, VOCABULARY)
        assert not violations(root)
        if (other := harden(tree, rng)) is not None:
            found = decode(other, VOCABULARY)
            assert not violations(found)
            assert abs(len(prefix(found)) - len(prefix(root))) <= 2
        seen |= {str(node.decorator) for node in prefix(root) if isinstance(node, ExtendedNode)}
    assert seen == set(map(str, DECORATORS))


@pytest.mark.parametrize("kind", [Kind.RETRY, Kind.TIMEOUT])
def test_decorators_get_around_the_root_and_leaves_that_fail(kind):
    tree = encode(Control.sequence(Symbol("do2", Kind.ACTION), Symbol("do3", Kind.ACTION)), VOCABULARY, NODES)
    failing = np.zeros(V, np.float32)
    failing[VOCABULARY.token(Symbol("do3", Kind.ACTION))] = 100
    rng, found = np.random.default_rng(0), set()
    for _ in range(80):
        other = hardened(rng, tree, failing, LOOKS, KINDS, gene_under_fallback=True)
        root = None if other is None else decode(other, VOCABULARY)
        if isinstance(root, ExtendedNode):
            found.add("root" if root.decorator.kind == kind else "")
        elif root is not None:
            found |= {str(node.children[0]) for node in root.children if isinstance(node, ExtendedNode)}
    assert found >= {"root", "do3"}
    assert "do2" not in found


def test_a_leaf_gets_in_front_of_one_that_it_may_help():
    tree = encode(Control.fallback(Symbol("do1", Kind.ACTION), Symbol("do2", Kind.ACTION)), VOCABULARY, NODES)
    rng = np.random.default_rng(0)
    found = {str(decode(other, VOCABULARY)) for _ in range(80) if (other := harden(tree, rng)) is not None}
    assert "Fallback(Sequence(do0, do1), do2)" in found


def test_what_is_taken_off_is_put_back():
    for tree in hard_trees():
        plain = bare(tree, KINDS)
        assert not (plain.tokens >= FIRST_LEAF + len(VOCABULARY.leaves)).any()
        again = decorated(plain, decoration_of(tree, KINDS), KINDS)
        np.testing.assert_array_equal(bare(again, KINDS).tokens, plain.tokens)
        nodes, once = prefix(decode(tree, VOCABULARY)), prefix(decode(plain, VOCABULARY))
        if len(set(once)) == len(once) and not any(map(_is_group, nodes)):
            assert prefix(decode(again, VOCABULARY)) == nodes


def _is_group(node):
    """Whether a decorator makes some children of one control node a group, which its kind does not."""
    if not isinstance(node, Control):
        return False
    below = [node.children[i] for i in range(len(node.children))]
    for i, child in enumerate(below):
        while isinstance(child, ExtendedNode):
            child = child.children[0]
        below[i] = child
    return any(isinstance(child, Control) and child.kind == node.kind for child in below)


def test_a_tree_that_is_full_stays_as_it_is():
    parts = [Symbol(f"do{i % 5}", Kind.ACTION) for i in range(NODES - 1)]
    full = encode(Control.sequence(*parts), VOCABULARY, NODES)
    small = encode(ExtendedNode("retry", (Control.sequence(*parts[:3]),), 2), VOCABULARY, NODES)
    same = decorated(full, decoration_of(small, KINDS), KINDS)
    np.testing.assert_array_equal(same.tokens, full.tokens)


def test_trees_do_the_same_without_what_did_nothing():
    removed = 0
    rng = np.random.default_rng(2)
    for tree in hard_trees():
        script = rng.choice([0, 1, 2], p=rng.dirichlet((1, 1, 1)), size=(10, V))
        told, trace = played(decode(tree, VOCABULARY), script)
        found = without_idle(tree, trace, KINDS, gene_under_fallback=True)
        again, _ = played(decode(found, VOCABULARY), script)
        assert told == again
        removed += int((tree.tokens >= FIRST_LEAF + 7).sum()) - int((found.tokens >= FIRST_LEAF + 7).sum())
    assert removed > 10


def played(root, script):
    """The statuses of a tree, and of what acts, over some ticks with given statuses of the leaves; and the trace."""
    nodes, memory = prefix(root), TreeMemory()
    trace, told = np.zeros(NODES, np.uint8), []
    for statuses in script:
        ticked = tick_tree(root, lambda leaf, _, row=statuses: Status(row[VOCABULARY.token(leaf)]), memory)
        memory = ticked.memory
        for at, status in enumerate(ticked.statuses):
            if status is not None and isinstance(nodes[at], Symbol):
                trace[at] |= 1 << status
        runs = None if ticked.running is None else nodes[ticked.running]
        told.append((ticked.status, str(runs) if isinstance(runs, Symbol) else None))
    return told, trace
