import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from bt_jax._util.statistics import mcnemar, wilson


@given(st.integers(1, 5000).flatmap(lambda tries: st.tuples(st.integers(0, tries), st.just(tries))))
def test_the_interval_is_that_of_scipy(counted):
    count, tries = counted
    expected = binomtest(count, tries).proportion_ci(method="wilson")
    assert wilson(count, tries) == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_without_tries_nothing_is_known():
    assert wilson(0, 0) == (0.0, 1.0)


@given(st.integers(0, 400), st.integers(0, 400))
def test_pairs_are_compared_as_by_the_binomial_test_of_scipy(first, second):
    expected = binomtest(first, first + second).pvalue if first + second else 1.0
    assert mcnemar(first, second) == pytest.approx(expected, rel=1e-6)
