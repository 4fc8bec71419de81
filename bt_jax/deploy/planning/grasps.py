"""Where the tool must be to grasp a box or to set one down: from above, its fingers along the faces of the box."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.robot.arrays import Point

__all__ = ["carried_pose", "grasp_poses", "put_poses", "raised", "yaw_of"]

DOWN = Rotation.from_euler("x", np.pi)  # z of the tool towards the floor
TURNS = np.arange(4) * np.pi / 2


def yaw_of(rotation: Rotation) -> float:
    """Return the angle [rad] about the vertical, in 0..pi/2, of the horizontal edges of a cube that lies on a face."""
    axes = rotation.as_matrix()
    level = axes[:, int(np.argmin(np.abs(axes[2])))]
    return float(np.arctan2(level[1], level[0]) % (np.pi / 2))


def grasp_poses(box: RigidTransform) -> list[RigidTransform]:
    """Return the four poses of the TCP from which a cube at `box` can be grasped from above; all in the base frame."""
    yaw = yaw_of(box.rotation)
    return [
        RigidTransform.from_components(box.translation, Rotation.from_euler("z", yaw + turn) * DOWN) for turn in TURNS
    ]


def put_poses(position: Point, yaw: float, held: RigidTransform) -> list[RigidTransform]:
    """Return the four poses of the TCP with which a box that is at `held` in its frame has its centre at `position` and
    its edges along `yaw` [rad]."""
    poses = []
    offset = yaw_of(DOWN * held.rotation)
    for turn in TURNS:
        rotation = Rotation.from_euler("z", yaw - offset + turn) * DOWN
        poses.append(RigidTransform.from_components(position - rotation.apply(held.translation), rotation))
    return poses


def carried_pose(tcp: RigidTransform, box: RigidTransform) -> RigidTransform:
    """Return the box in the TCP's frame once the fingers have closed: they centre it and align it with themselves."""
    held = tcp.inv() * box
    turn = held.rotation.as_matrix()
    nearest = np.round(turn)  # a cube fits in 24 ways
    aligned = Rotation.from_matrix(nearest) if abs(abs(np.linalg.det(nearest)) - 1) < 1e-9 else held.rotation
    return RigidTransform.from_components([0.0, *held.translation[1:]], aligned)


def raised(pose: RigidTransform, height: float) -> RigidTransform:
    """Return the same pose, `height` metres above."""
    return RigidTransform.from_components(pose.translation + np.array([0, 0, height]), pose.rotation)
