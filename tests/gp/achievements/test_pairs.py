"""Counts of pairs are those of a table of all pairs, to the last digit, in the memory of those that were met."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.gp.achievements.pairs import Pairs

TOKENS = 6
share = st.sampled_from([0.1, 0.25, 0.3, 0.5, 1.0])
token = st.integers(0, TOKENS - 1)
batches = st.lists(st.lists(st.tuples(token, token, share), max_size=12), max_size=4)


@given(batches, st.sampled_from([0, (1 << 15) - TOKENS]))
def test_pairs_are_counted_as_in_a_table_of_all(batches, offset):
    pairs = Pairs.empty()
    stood, worked = np.zeros((2, TOKENS, TOKENS), np.float32)
    for batch in batches:
        first, second = (np.array([row[i] for row in batch], np.int16) for i in range(2))
        more = np.array([row[2] for row in batch], np.float32)
        pairs = pairs.with_(first + np.int16(offset), second + np.int16(offset), np.ones_like(more), more)
        np.add.at(stood, (first, second), 1)
        np.add.at(worked, (first, second), more)
    each = np.arange(TOKENS) + offset
    found = pairs.counts(each[:, None], each)
    np.testing.assert_array_equal(found[0], stood)
    np.testing.assert_array_equal(found[1], worked)
    assert len(pairs.keys) == np.count_nonzero(stood)
    assert (np.diff(pairs.keys) > 0).all()
