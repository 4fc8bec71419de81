"""Trees put together from parts are the trees that the same parts make as Python objects."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import Control, Kind, Symbol, Vocabulary
from bt_jax.encoding.arrays import Trees, decode, encode, encode_all
from bt_jax.encoding.walk import prefix, tidy
from bt_jax.gp.achievements.compose import children_of, compose, leaf_parts
from tests.helpers.samples import random_tree

LEAVES = [Symbol(name, Kind.GENE) for name in "abcd"]
VOCABULARY = Vocabulary.of(LEAVES)
NODES = 16


@st.composite
def trees(draw, most_leaves=5):
    rng = np.random.default_rng(draw(st.integers(0, 1 << 32)))
    return tidy(random_tree(rng, LEAVES, draw(st.integers(1, most_leaves))))


def together(rows):
    """Parts [M, K, N] of rows of trees; None is no part."""
    most = max(map(len, rows))
    padded = [row + [None] * (most - len(row)) for row in rows]
    nothing = Trees(np.zeros(NODES, np.int16), np.zeros(NODES, np.uint8))
    parts = [[nothing if part is None else encode(part, VOCABULARY, NODES) for part in row] for row in padded]
    return Trees(
        np.array([[part.tokens for part in row] for row in parts]),
        np.array([[part.sizes for part in row] for row in parts]),
    )


def expected(row, kind):
    children, last = [], None
    for part in row:
        if part is not None and not (isinstance(part, Symbol) and part == last):
            children.append(part)
        last = part if part is not None else last
    return tidy(Control(kind, tuple(children)))


@given(
    st.lists(st.lists(st.none() | trees(), min_size=1, max_size=4), min_size=1, max_size=5),
    st.sampled_from([Kind.SEQUENCE, Kind.FALLBACK]),
)
def test_parts_become_the_children_of_one_control_node(rows, kind):
    found, fits = compose(together(rows), kind)
    for row, (tokens, sizes), fit in zip(rows, zip(found.tokens, found.sizes, strict=True), fits, strict=True):
        tree = expected(row, kind)
        assert fit == (tree is not None and len(prefix(tree)) <= NODES)
        if fit:
            assert decode(Trees(tokens, sizes), VOCABULARY) == tree
        else:
            assert not tokens.any()


@given(st.lists(trees(), min_size=1, max_size=5))
def test_children_of_a_sequence_compose_to_it_again(found):
    encoded = encode_all(found, VOCABULARY, NODES)
    again, fits = compose(children_of(encoded))
    for i, tree in enumerate(found):
        plain = isinstance(tree, Symbol) or tree.kind == Kind.FALLBACK
        repeats = not plain and any(
            a == b and isinstance(a, Symbol) for a, b in zip(tree.children, tree.children[1:], strict=False)
        )
        if not repeats:
            assert fits[i]
            assert decode(again[i], VOCABULARY) == tree


@pytest.mark.parametrize("count", [0, 1, 7])
def test_any_number_of_trees(count):
    found, fits = compose(leaf_parts(np.tile(np.array([3, 4, 0, 5]), (count, 1)), NODES))
    assert found.tokens.shape == (count, NODES)
    assert fits.all()
    assert (found.sizes[:, 0] == 4).all()
