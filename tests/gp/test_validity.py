"""The vectorized rules say what the rules in words say."""

import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import Control, Kind, Vocabulary
from bt_jax.encoding.arrays import Trees, decode, encode, encode_all, violations
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.gp.validity import is_valid
from tests.helpers.populations import CASES, NODES, PAPER, SLOW, population
from tests.helpers.strategies import ATOMS, trees

LEAVES = (*ATOMS[:5], *ATOMS[-4:])
VOCABULARY = Vocabulary.of(LEAVES)
ALPHABET = Alphabet.of(VOCABULARY)


def any_trees() -> st.SearchStrategy:
    """Trees that may break any rule."""
    kinds = st.sampled_from([Kind.SEQUENCE, Kind.FALLBACK])
    children = lambda tree: st.lists(tree, min_size=1, max_size=3).map(tuple)  # noqa: E731
    return st.recursive(st.sampled_from(LEAVES), lambda tree: st.builds(Control, kinds, children(tree)), max_leaves=6)


@given(st.one_of(any_trees(), trees(leaves=LEAVES)))
def test_is_valid_agrees_with_violations(tree):
    encoded = encode(tree, VOCABULARY, 32)
    batch = jax.tree.map(lambda field: field[None], encoded)
    assert bool(is_valid(batch, ALPHABET, gene_under_fallback=True)[0]) == (not violations(tree))


def test_changed_tokens_are_valid_only_if_their_trees_are():
    alphabet = Alphabet(3, 2, 0)
    pool = Vocabulary.of(ATOMS[:3] + ATOMS[-2:])
    found = random_trees(jax.random.key(0), alphabet, count=200, num_nodes=16, nodes=9)
    rng = np.random.default_rng(0)
    tokens = np.array(found.tokens)
    row = np.arange(len(tokens))
    at = rng.integers(0, np.asarray(found.sizes[:, 0]))
    tokens[row, at] = np.where(tokens[row, at] < 3, 3 - tokens[row, at], rng.integers(3, 8, len(tokens)))
    broken = Trees(tokens, np.asarray(found.sizes))
    expected = [not violations(decode(broken[i], pool)) for i in row]
    assert 0 < sum(expected) < len(expected)
    np.testing.assert_array_equal(is_valid(broken, alphabet, gene_under_fallback=True), expected)


@pytest.mark.parametrize("field", ["tokens", "sizes"])
def test_broken_arrays_are_not_valid(field):
    trees = encode_all([Control.sequence(LEAVES[0], LEAVES[-1], LEAVES[-2])] * 50, VOCABULARY, 16)
    for column, wrong in ((0, 0), (15, 1), (2, 25)):
        values = np.array(getattr(trees, field))
        values[:, column] = wrong if values[0, column] != wrong else wrong + 1
        assert not np.asarray(is_valid(dataclasses.replace(trees, **{field: values}), ALPHABET)).any()


@pytest.mark.parametrize(("alphabet", "num_nodes", "gene_under_fallback"), CASES)
def test_random_trees_are_valid_and_as_large_as_asked(alphabet, num_nodes, gene_under_fallback):
    trees = population(alphabet, num_nodes, gene_under_fallback, steps=0)
    assert np.asarray(is_valid(trees, alphabet, gene_under_fallback=gene_under_fallback)).all()
    sizes = np.asarray(trees.sizes[:, 0])
    assert sizes.min() >= 3
    assert sizes.max() <= NODES
    if alphabet.num_leaves > 4:
        assert (sizes == NODES).mean() > 0.9


@pytest.mark.parametrize("nodes", [3, 4, pytest.param(20, marks=SLOW)])
def test_random_trees_of_several_sizes(nodes):
    trees = random_trees(jax.random.key(0), PAPER, count=500, num_nodes=64, nodes=nodes)
    assert np.asarray(is_valid(trees, PAPER)).all()
    assert (np.asarray(trees.sizes[:, 0]) == nodes).mean() > 0.9
