"""What one image shows of the bodies of a task: the only thing that watching knows of a camera."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform

__all__ = ["Seen", "Sighting", "distance_between", "turn_between"]


@dataclasses.dataclass(frozen=True)
class Seen:
    """A body as one image shows it: `pose` in the robot's base frame [m], `sigma` the standard deviation of its position
    [m], and whether something `covered` a part of it that should be visible."""

    pose: RigidTransform
    sigma: float
    covered: bool = False


@dataclasses.dataclass(frozen=True)
class Sighting:
    """One image, taken at `time` [s]: the bodies that it shows, and those that are `screened` behind others, so that no hand
    is needed to hide them."""

    time: float
    bodies: Mapping[str, Seen]
    screened: frozenset[str] = frozenset()


def distance_between(a: RigidTransform, b: RigidTransform) -> float:
    """Return how far the origins of two frames are apart, m."""
    return math.dist(a.translation, b.translation)


def turn_between(a: RigidTransform, b: RigidTransform) -> float:
    """Return the angle between the axes of two frames, rad."""
    cosine = (float(np.sum(a.as_matrix()[:3, :3] * b.as_matrix()[:3, :3])) - 1) / 2
    return math.acos(max(-1.0, min(1.0, cosine)))
