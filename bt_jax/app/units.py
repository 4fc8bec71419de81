"""Lengths as people on a shop floor read and write them: in millimetres, while the library computes in metres."""

from __future__ import annotations

import math
from typing import SupportsFloat

__all__ = ["in_metres", "in_millimetres", "length"]

MILLIMETRES = 1000.0  # in a metre


def in_millimetres(metres: SupportsFloat) -> float:
    """Return a length as the page shows it: in whole millimetres, and never minus zero."""
    return round(MILLIMETRES * float(metres)) + 0.0


def in_metres(millimetres: float) -> float:
    """Return a length that a person has written, for the library."""
    return millimetres / MILLIMETRES


def length(metres: SupportsFloat) -> str:
    """Say a length, rounded to whole millimetres: "25 mm"."""
    return f"{math.floor(round(MILLIMETRES * float(metres), 3) + 0.5)} mm"
