"""Placements, and the solids that stand for a robot's links. Lengths in metres, angles in radians."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

__all__ = [
    "Box",
    "Capsule",
    "Cylinder",
    "Hull",
    "Link",
    "LinkShape",
    "Placement",
    "Solid",
    "Vec3",
    "highest",
    "placement_matrix",
]

Vec3 = tuple[float | int, float | int, float | int]
Placement = tuple[Vec3, Vec3]  # xyz [m], rpy [rad] about fixed axes x, y, z
Link = int | str
"""0 is the robot's body, 1 to n are the links of an arm in chain order, then come "hand", "finger_a", "finger_b"."""


def placement_matrix(placement: Placement) -> Float[np.ndarray, "4 4"]:
    """Return a placement as a homogeneous matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("xyz", placement[1]).as_matrix(), placement[0]
    return matrix


@dataclasses.dataclass(frozen=True)
class Box:
    """A box with its edges along the axes of the link."""

    centre: Vec3
    edges: Vec3


@dataclasses.dataclass(frozen=True)
class Capsule:
    """All within `radius` of the line from `start` to `end`."""

    start: Vec3
    end: Vec3
    radius: float


@dataclasses.dataclass(frozen=True)
class Cylinder:
    """A cylinder around the z axis of the link, its middle at the origin."""

    radius: float
    height: float


@dataclasses.dataclass(frozen=True)
class Hull:
    """The convex hull of its corners."""

    corners: tuple[Vec3, ...]


Solid = Box | Capsule | Cylinder | Hull


def highest(solid: Box | Capsule | Hull) -> float:
    """Return the largest z of a solid's points in its link's frame, m."""
    match solid:
        case Box(centre, edges):
            return centre[2] + edges[2] / 2
        case Capsule(start, end, radius):
            return max(start[2], end[2]) + radius
        case Hull(corners):
            return max(z for _, _, z in corners)


@dataclasses.dataclass(frozen=True)
class LinkShape:
    """A solid that stands for a link, or for a part of it, in the link's frame. A `pad` is what a finger grips with."""

    link: Link
    solid: Box | Capsule | Hull
    dark: bool = False
    pad: bool = False
