"""What "at", "rests on", "clear" and "reachable" mean, for single objects: plain functions of numbers.

This is the reference. The simulation computes the same for batches of states (`mjx_env.semantics`) with the constants of
`GEOMETRY`, and a test compares both; the robot calls these functions. Lengths are metres, z points up; positions are those
of centres. A cube's size is its edge.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable

__all__ = ["GEOMETRY", "Geometry", "is_at", "is_reachable", "rests_on"]


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Shares of sizes by which geometric conditions are decided.

    Centres of a tilted cube are up to sqrt(3) apart; `above_least` to `above_most` of the mean size covers what lies on top
    and not what lies beside.
    """

    above_least: float = 0.6  # of the mean size: the least height of a cube over the one that it rests on
    above_most: float = 1.3  # and the largest
    upright: float = 0.97  # cosine of the inclination up to which an object counts as upright: 14 degrees
    seated: float = 0.1  # of its size: how far below the lowest table's top a cube may be, and still be within reach


GEOMETRY = Geometry()


def is_at(position: Iterable[float], goal: Iterable[float], tolerance: float) -> bool:
    """Is a position less than `tolerance` away from a goal?"""
    return math.dist(tuple(position), tuple(goal)) < tolerance


def rests_on(
    upper: Iterable[float],
    lower: Iterable[float],
    upper_size: float,
    lower_size: float,
    *,
    above_most: float = GEOMETRY.above_most,
) -> bool:
    """Does a cube stand over another one, close enough to rest on it? A cube is clear if none rests on it.

    A larger `above_most` includes a cube that is released there and falls onto the other one.
    """
    middle = (upper_size + lower_size) / 2
    x, y, z = (a - b for a, b in zip(upper, lower, strict=True))
    above = GEOMETRY.above_least * middle < z < above_most * middle
    return bool(above and max(abs(x), abs(y)) < middle)  # of NumPy numbers, too


def is_reachable(height: float, lowest_top: float, size: float) -> bool:
    """Is a cube at this height not below the lowest table's top, that is, not on the floor?"""
    return height > lowest_top - GEOMETRY.seated * size
