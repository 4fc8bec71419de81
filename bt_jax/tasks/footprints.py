"""What objects cover, seen from above, and by how much two of them overlap there."""

from __future__ import annotations

import dataclasses
import math

from bt_jax.tasks.things import Object, Vec2

__all__ = ["Footprint", "overlap"]


@dataclasses.dataclass(frozen=True)
class Footprint:
    """A rectangle turned by `turn` degrees, or a circle of radius `half[0]`: its middle and half its edges [m]."""

    middle: Vec2
    half: Vec2
    turn: float = 0.0
    is_round: bool = False

    @classmethod
    def of(cls, thing: Object, middle: Vec2, turn: float | None) -> Footprint:
        """Return what an upright object covers; if its turn is not known, the circle that it covers in every turn."""
        half = thing.size[0] / 2, thing.size[1] / 2
        if thing.shape == "cylinder" or turn is None:
            return cls(middle, (min(half), min(half)), is_round=True)
        return cls(middle, half, turn)


def overlap(one: Footprint, other: Footprint) -> float:
    """Return how far one would have to move to be free of the other, metres; zero or less if it is.

    For two rectangles, along one of the four edges' directions (the separating axis theorem).
    """
    apart = other.middle[0] - one.middle[0], other.middle[1] - one.middle[1]
    if one.is_round and other.is_round:
        return one.half[0] + other.half[0] - math.hypot(*apart)
    if one.is_round or other.is_round:
        circle, rectangle = (one, other) if one.is_round else (other, one)
        x, y = (abs(a) - b for a, b in zip(_along(rectangle.turn, apart), rectangle.half, strict=True))
        outside = math.hypot(max(x, 0.0), max(y, 0.0))
        return circle.half[0] - (outside or max(x, y))
    depths = []
    for turn in (one.turn, other.turn):
        for axis in (0, 1):
            reach = _reach(one, turn, axis) + _reach(other, turn, axis)
            depths.append(reach - abs(_along(turn, apart)[axis]))
    return min(depths)


def _along(turn: float, vector: Vec2) -> Vec2:
    """Return a vector's components along the axes of a turned frame."""
    c, s = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return c * vector[0] + s * vector[1], c * vector[1] - s * vector[0]


def _reach(one: Footprint, turn: float, axis: int) -> float:
    """Return half the extent of a rectangle along an axis of a turned frame."""
    c, s = abs(math.cos(math.radians(one.turn - turn))), abs(math.sin(math.radians(one.turn - turn)))
    return c * one.half[axis] + s * one.half[1 - axis]
