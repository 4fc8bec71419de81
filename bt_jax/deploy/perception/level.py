"""Which way up a box lies. A cube has no top of its own: whichever face is up, "on top of it" is against gravity."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

__all__ = ["lean", "level"]


def lean(pose: RigidTransform) -> float:
    """Return the angle between the vertical and the axis of the body that is nearest to it, rad."""
    return math.acos(min(1.0, float(np.abs(pose.rotation.as_matrix()[2]).max())))


def level(pose: RigidTransform) -> RigidTransform:
    """Return a cube's frame with that axis as z which points up most nearly. Frames of upright cubes stay; one that was
    tipped over, about an axis of its own, keeps its yaw; one that is upside down is turned about its x axis."""
    up = pose.rotation.as_matrix()[2]
    axis = int(np.argmax(np.abs(up)))
    if axis == 2:
        turn = Rotation.identity() if up[2] > 0 else Rotation.from_euler("x", math.pi)
    else:
        new = np.sign(up[axis]) * np.eye(3)[axis]
        turn = Rotation.from_rotvec(math.pi / 2 * np.cross([0, 0, 1], new))
    return RigidTransform.from_components(pose.translation, pose.rotation * turn)
