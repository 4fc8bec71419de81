import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from bt_jax._util.statistics import wilson


@given(st.integers(1, 5000).flatmap(lambda tries: st.tuples(st.integers(0, tries), st.just(tries))))
def test_the_interval_is_that_of_scipy(counted):
    count, tries = counted
    expected = binomtest(count, tries).proportion_ci(method="wilson")
    assert wilson(count, tries) == pytest.approx((expected.low, expected.high), abs=1e-9)


def test_without_tries_nothing_is_known():
    assert wilson(0, 0) == (0.0, 1.0)
