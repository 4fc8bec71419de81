"""Outcomes as numbers stand for the same outcomes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bt_jax.mjx_env.episodes.codes import NOT_COMPUTED, OutcomeCodes, TooManyOutcomesError

TOKENS = 4
OUTCOMES = st.sampled_from([*range(12), 2**31 - 1])
SOME = st.sets(st.integers(0, TOKENS - 1)).map(lambda tokens: np.array(sorted(tokens), int))
BATCH = st.tuples(SOME, st.integers(0, 30)).flatmap(
    lambda drawn: st.tuples(st.just(drawn[0]), arrays.arrays(np.int32, (2, drawn[1], len(drawn[0])), elements=OUTCOMES))
)


def decoded(codes, numbers, tokens):
    return codes.meanings[:, tokens, numbers]


@given(st.lists(BATCH, min_size=1, max_size=4))
def test_a_number_stands_for_one_outcome_from_then_on(batches):
    codes, found = OutcomeCodes(TOKENS, np.uint8), []
    for tokens, batch in batches:
        before = codes.meanings
        numbers, are_new = codes.encode(batch, tokens)
        assert numbers.dtype == np.uint8
        assert are_new == (not np.array_equal(codes.meanings, before))
        found.append(numbers)
    for (tokens, batch), numbers in zip(batches, found, strict=True):
        assert (numbers > 0).all()
        np.testing.assert_array_equal(decoded(codes, numbers, tokens), batch)
        again, are_new = codes.encode(batch, tokens)
        assert not are_new
        np.testing.assert_array_equal(again, numbers)
    assert (codes.meanings[:, :, 0] == NOT_COMPUTED).all()


def test_more_outcomes_than_numbers_are_refused():
    every = np.arange(TOKENS)
    many = np.tile(np.arange(256, dtype=np.int32)[:, None], (2, 1, TOKENS))
    for kind, count in ((np.uint8, 255), (np.uint16, 256)):
        codes = OutcomeCodes(TOKENS, kind)
        numbers, _ = codes.encode(many[:, :count], every)
        np.testing.assert_array_equal(decoded(codes, numbers, every), many[:, :count])
    with pytest.raises(TooManyOutcomesError):
        OutcomeCodes(TOKENS, np.uint8).encode(many, every)
