"""How demonstrations turn an object: clusters of angles on a circle, on which turns that look alike are one.

A person turns an object only where it matters, so turns count as meant if so many would hardly be this close together by
chance. Of a cube, which looks alike after every right angle, that takes more, and somebody must have turned it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from bt_jax.lfd.clustering import NEEDED, Observed
from bt_jax.lfd.dbscan import dbscan
from bt_jax.tasks import Object

__all__ = ["REACH", "Turn", "apart", "common_turn", "doubtful_turn", "shown_turn"]

REACH = 10.0  # degrees; turns that agree are no further than this from their mean
HAND = 5.0  # degrees; how exactly a person turns things
CHANCE = 0.02  # how probable it may be that unrelated turns agree as well as those that are taken as meant
CHANCE_SQUARE = 0.002  # the same where an object looks alike after every right angle, and a turn rarely matters
DOUBT = 10.0  # chances that differ from those by no more than this factor do not decide


@dataclasses.dataclass(frozen=True)
class Turn:
    """The turn in which `size` of several agree: their mean in whole degrees, and the largest distance from it."""

    degrees: float
    size: int
    spread: float


def shown_turn(rows: Sequence[Observed], frame: str, thing: Object) -> Turn | None:
    """Return how placements turn an object in a frame; None where they do not agree, or where it does not matter.

    Fewer than are needed to infer a frame are taken as they are, but for the turns of a cube.
    """
    square, few = thing.symmetry == 90, len(rows) < NEEDED
    turns = np.array([one.turn(frame) for one in rows])
    if not thing.symmetry or (square and few) or np.isnan(turns).any():
        return None
    if square:
        before = np.array([one.turn_before(frame) for one in rows])
        if not np.median(apart(turns, before, thing.symmetry)) > HAND:
            return None
    return common_turn(turns, thing.symmetry, chance=1.0 if few else CHANCE_SQUARE if square else CHANCE)


def doubtful_turn(rows: Sequence[Observed], frame: str, thing: Object) -> Turn | None:
    """Return the turn in a frame of which it is in doubt whether it is meant, None if there is none: it would be by chance
    in about as many cases as decide it, or the object lay like that before."""
    square = thing.symmetry == 90
    turns, before = np.array([one.turn(frame) for one in rows]), np.array([one.turn_before(frame) for one in rows])
    if not thing.symmetry or len(rows) < NEEDED or np.isnan([turns, before]).any():
        return None
    was_turned = float(np.median(apart(turns, before, thing.symmetry))) > HAND
    chance = CHANCE_SQUARE if square else CHANCE
    found = common_turn(turns, thing.symmetry, chance=DOUBT * chance)
    if found is None or not was_turned:
        return None if square else found
    return found if common_turn(turns, thing.symmetry, chance=chance / DOUBT) is None else None


def common_turn(turns: Float[np.ndarray, " n"], symmetry: float, *, chance: float = CHANCE) -> Turn | None:
    """Return the turn, degrees from 0 to `symmetry`, in which most of several agree; None where they do not, or where that
    is more probable than `chance` for unrelated ones.

    That n unrelated angles lie on a share w of a circle, at most a half, has the probability n w^(n-1) (W. L. Stevens,
    Solution to a geometrical problem in probability, 1939); any choice of n of them and any n that is enough may do so.
    """
    count = len(turns)
    least = max(min(NEEDED, count), count // 2 + 1)
    angles = np.radians(turns) * 360 / symmetry
    points = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    labels = dbscan(points, 2 * math.sin(math.radians(REACH * 360 / symmetry) / 2), least)
    if labels.max() < 0:
        return None
    rows = np.flatnonzero(labels == 0)  # of a majority there is one
    x, y = points[rows].mean(axis=0)
    mean = math.degrees(math.atan2(y, x)) * symmetry / 360
    off = (turns[rows] - mean + symmetry / 2) % symmetry - symmetry / 2
    n, width = len(rows), float(np.ptp(off)) / symmetry
    if np.abs(off).max() > REACH or (count - least + 1) * math.comb(count, n) * n * width ** (n - 1) > chance:
        return None
    degrees = float(round(mean % symmetry) % symmetry)
    return Turn(degrees, n, float(apart(turns[rows], degrees, symmetry).max()))


def apart(a: Float[np.ndarray, " n"], b: Float[np.ndarray, " n"] | float, symmetry: float) -> Float[np.ndarray, " n"]:
    """Return how far turns are apart [degrees] where those look alike that differ by multiples of `symmetry`."""
    off = np.abs(a - b) % symmetry
    return np.minimum(off, symmetry - off)
