"""Intervals and tests of what was counted."""

from __future__ import annotations

import math

__all__ = ["mcnemar", "wilson"]

Z95 = 1.959963984540054  # quantile 0.975 of the normal distribution


def wilson(count: int, tries: int, z: float = Z95) -> tuple[float, float]:
    """Return the interval of Wilson (1927) for the probability of what happened `count` times in so many tries, by default
    that with a coverage of 95 %; without tries, (0, 1)."""
    if tries == 0:
        return 0.0, 1.0
    share, weight = count / tries, z * z / tries
    centre = share + weight / 2
    half = math.sqrt(weight * (share * (1 - share) + weight / 4))
    low, high = (centre - half) / (1 + weight), (centre + half) / (1 + weight)
    return (low if count else 0.0), (high if count < tries else 1.0)


def mcnemar(only_first: int, only_second: int) -> float:
    """Return the exact two-sided p-value of McNemar's test (1947). Of the pairs in which just one of two has succeeded, it
    was the first in so many, and the second in so many."""
    pairs, least = only_first + only_second, min(only_first, only_second)
    tail = sum(math.comb(pairs, k) for k in range(least + 1))
    return min(1.0, 2 * tail / (1 << pairs))
