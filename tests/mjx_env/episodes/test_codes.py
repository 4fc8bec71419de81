"""Outcomes as numbers stand for the same outcomes."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from bt_jax.mjx_env.episodes.codes import OutcomeCodes, TooManyOutcomesError

TOKENS = 3
OUTCOMES = st.sampled_from([*range(12), 2**31 - 1])
BATCH = st.integers(0, 30).flatmap(lambda states: arrays.arrays(np.int32, (2, states, TOKENS), elements=OUTCOMES))


def decoded(codes, numbers):
    return codes.meanings[:, np.arange(TOKENS), numbers]


@given(st.lists(BATCH, min_size=1, max_size=4))
def test_a_number_stands_for_one_outcome_from_then_on(batches):
    codes, found = OutcomeCodes(TOKENS, np.uint8), []
    for batch in batches:
        before = codes.meanings
        numbers, are_new = codes.encode(batch)
        assert numbers.dtype == np.uint8
        assert are_new == (not np.array_equal(codes.meanings, before))
        found.append(numbers)
    for batch, numbers in zip(batches, found, strict=True):
        np.testing.assert_array_equal(decoded(codes, numbers), batch)
    again = [codes.encode(batch) for batch in batches]
    assert not any(are_new for _, are_new in again)
    for numbers, (same, _) in zip(found, again, strict=True):
        np.testing.assert_array_equal(same, numbers)


def test_more_outcomes_than_numbers_are_refused():
    many = np.tile(np.arange(257, dtype=np.int32)[:, None], (2, 1, TOKENS))
    codes = OutcomeCodes(TOKENS, np.uint8)
    np.testing.assert_array_equal(decoded(codes, codes.encode(many[:, :256])[0]), many[:, :256])
    with pytest.raises(TooManyOutcomesError):
        codes.encode(many)
    np.testing.assert_array_equal(decoded(wider := OutcomeCodes(TOKENS, np.uint16), wider.encode(many)[0]), many)
