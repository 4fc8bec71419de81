"""Placements, and the primitives that stand for a robot's links. Lengths in metres, angles in radians."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

__all__ = ["LinkShape", "Placement", "Vec3", "placement_matrix"]

Vec3 = tuple[float | int, float | int, float | int]
Placement = tuple[Vec3, Vec3]  # xyz [m], rpy [rad] about fixed axes x, y, z


def placement_matrix(placement: Placement) -> Float[np.ndarray, "4 4"]:
    """Return a placement as a homogeneous matrix."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("xyz", placement[1]).as_matrix(), placement[0]
    return matrix


@dataclasses.dataclass(frozen=True)
class LinkShape:
    """A primitive around a link, in its frame: a capsule from `start` to `end`, or a box with centre `start` and edges
    `end`. Link 0 is the robot's body, 1 to n the arm's in chain order, then "hand", "finger_a", "finger_b"."""

    link: int | str
    kind: str
    start: Vec3
    end: Vec3
    radius: float = 0.0
    dark: bool = False

    @property
    def placement(self) -> RigidTransform:
        """Of its centre; the axis of a capsule is its z."""
        if self.kind == "box":
            return RigidTransform.from_translation(self.start)
        start, end = np.array(self.start), np.array(self.end)
        rotation = Rotation.align_vectors([end - start], [[0, 0, 1.0]])[0]
        return RigidTransform.from_components((start + end) / 2, rotation)

    @property
    def length(self) -> float:
        """Between the centres of a capsule's ends."""
        return float(np.linalg.norm(np.subtract(self.end, self.start)))
