"""What one image shows of the bodies of a task: the only thing that watching knows of a camera."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from scipy.spatial.transform import RigidTransform

__all__ = ["Seen", "Sighting"]


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
