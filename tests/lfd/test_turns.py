"""Turns on a circle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.lfd.turns import REACH, apart, common_turn

angles = st.floats(-720, 720)
symmetries = st.sampled_from([90.0, 180.0])


@given(turns=st.lists(angles, min_size=1, max_size=8), symmetry=symmetries)
def test_what_is_taken_is_near_to_most(turns, symmetry):
    found = common_turn(np.array(turns), symmetry)
    if found is None:
        return
    near = apart(np.array(turns), found.degrees, symmetry) <= found.spread + 1e-9
    assert near.sum() >= found.size > len(turns) // 2
    assert found.spread <= REACH + 0.5  # it is rounded to degrees
    assert 0 <= found.degrees < symmetry


@given(
    turns=st.lists(st.floats(-3, 3), min_size=3, max_size=8),
    off=angles,
    quarters=st.lists(st.integers(-4, 4), min_size=8, max_size=8),
    symmetry=symmetries,
)
def test_turns_that_look_alike_are_one(turns, off, quarters, symmetry):
    turned = np.array(turns) + off
    alike = turned + symmetry * np.array(quarters[: len(turns)])
    one, other = common_turn(turned, symmetry), common_turn(alike, symmetry)
    assert (one is None) == (other is None)
    if one is not None:
        assert apart(np.array([one.degrees]), other.degrees, symmetry)[0] <= 1
        assert apart(np.array([one.degrees]), off + float(np.mean(turns)), symmetry)[0] <= 6


@pytest.mark.parametrize("symmetry", [90.0, 180.0])
@pytest.mark.parametrize("count", [3, 5, 8])
def test_unrelated_turns_seldom_agree(symmetry, count):
    """As seldom as is said, with three times the standard error of slack."""
    rng, tries = np.random.default_rng(count), 2000
    agree = sum(common_turn(rng.uniform(0, 360, count), symmetry, chance=0.02) is not None for _ in range(tries))
    assert agree / tries <= 0.02 + 3 * (0.02 / tries) ** 0.5


def test_one_outlier_of_many_does_not_count():
    found = common_turn(np.array([90.0, 91, 89, 88, 92, 10]), 180.0)
    assert (found.degrees, found.size) == (90, 5)
    assert common_turn(np.array([90.0, 10, 50]), 180.0) is None
