"""Intervals of what was counted."""

from __future__ import annotations

import math

__all__ = ["wilson"]

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
