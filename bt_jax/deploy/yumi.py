"""ABB YuMi (IRB 14000): its joints and shapes in one table, and forward kinematics in NumPy.

The joints are ABB's nominal ones; the shapes are primitives of our own around the links, a little larger than the links. The
chain order of the seven axes is ABB's 1, 2, 7, 3, 4, 5, 6. All axes turn about the z of their frames. Lengths in metres,
angles in radians.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

__all__ = [
    "ARMS",
    "BODY",
    "HOME",
    "LOWER",
    "OPENING",
    "SHAPES",
    "SPEED",
    "TCP",
    "UPPER",
    "JointRows",
    "Joints",
    "LinkShape",
    "Point",
    "PoseRow",
    "actuator_names",
    "finger_names",
    "flange",
    "forward",
    "joint_names",
    "link_name",
    "link_poses",
    "points",
    "tip_matrix",
]

Joints = Float[np.ndarray, " 7"]
"""The joints of one arm in chain order, rad."""
JointRows = Float[np.ndarray, "n 7"]
"""Configurations of one arm, one a row."""
PoseRow = Float[np.ndarray, " 7"]
"""Position [m] and quaternion wxyz."""
Point = Float[np.ndarray, " 3"]
"""A position, m."""

ARMS = ("left", "right")
BODY = "yumi_body"
Vec3 = tuple[float | int, float | int, float | int]
Placement = tuple[Vec3, Vec3]  # xyz [m], rpy [rad] about fixed axes x, y, z

BASE: Mapping[str, Placement] = {
    "left": ((0.053711, 0.072573, 0.415010), (0.979068, -0.569211, 2.316178)),
    "right": ((0.053711, -0.072573, 0.415010), (-0.979068, -0.569211, -2.316178)),
}
QUARTER = np.pi / 2
AXES = (1, 2, 7, 3, 4, 5, 6)  # ABB's numbers in chain order
LINKS: tuple[Placement, ...] = (  # of each joint after the first in the link before it
    ((0.03, 0, 0.1), (QUARTER, 0, 0)),
    ((-0.03, 0.1725, 0), (-QUARTER, 0, 0)),
    ((-0.0405, 0, 0.079), (QUARTER, -QUARTER, 0)),
    ((0.0405, 0.1645, 0), (-QUARTER, 0, 0)),
    ((-0.027, 0, 0.1005), (QUARTER, 0, 0)),
    ((0.027, 0.029, 0), (-QUARTER, 0, 0)),
)
LOWER = np.radians([-168.5, -143.5, -168.5, -123.5, -290, -88, -229])
UPPER = np.radians([168.5, 43.5, 168.5, 80, 290, 138, 229])
SPEED = np.radians([180, 180, 180, 180, 400, 400, 400])
HAND: Placement = ((0, 0, 0.007), (0, 0, np.pi))  # tool0, where the gripper begins
FINGERS: tuple[Placement, ...] = (((0, -0.0065, 0.0837), (0, 0, 0)), ((0, 0.0065, 0.0837), (0, 0, np.pi)))
STROKE = 0.025  # of a finger, along its -x
OPENING = 2 * STROKE
TCP: Vec3 = (0, 0, 0.13)  # between the finger tips, in tool0
OWN_APART, BODY_APART = 5, 4  # links that are less far apart in the chain cannot meet (or always overlap)

CALIBRATION = {arm: np.radians([0, -130, sign * 135, 30, 0, 40, 0]) for arm, sign in (("left", 1), ("right", -1))}
"""ABB's calibration pose in chain order."""


@dataclasses.dataclass(frozen=True)
class LinkShape:
    """A primitive around a link, in its frame: a capsule from `start` to `end`, or a box with centre `start` and edges
    `end`. Link 0 is the body, 1 to 7 the arm's in chain order, then "hand", "finger_a", "finger_b"."""

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


def _capsule(link: int, radius: float, dark: bool = False) -> LinkShape:
    return LinkShape(link, "capsule", (0, 0, 0), LINKS[link - 1][0], radius, dark)


_FINGER = (
    (
        "box",
        (-0.006, 0.0065, 0.028),
        (0.008, 0.014, 0.056),
    ),  # ends 8 mm beyond the TCP; the pad is its face at x = -2 mm
    ("box", (-0.001, 0.0065, 0.0443), (0.002, 0.016, 0.02)),
)
SHAPES: tuple[LinkShape, ...] = (
    LinkShape(0, "box", (-0.06, 0, 0.19), (0.2, 0.2, 0.36)),
    LinkShape(0, "box", (-0.01, 0, 0.42), (0.16, 0.12, 0.16)),
    _capsule(1, 0.06),
    _capsule(2, 0.055),
    _capsule(3, 0.05, dark=True),
    _capsule(4, 0.047),
    _capsule(5, 0.042, dark=True),
    _capsule(6, 0.036),
    LinkShape(7, "capsule", (0, 0, -0.01), (0, 0, 0.004), 0.032, dark=True),
    LinkShape("hand", "box", (0, 0, 0.042), (0.09, 0.05, 0.08)),
    *(LinkShape(name, *box, dark=True) for name in ("finger_a", "finger_b") for box in _FINGER),
)


def joint_names(arm: str) -> tuple[str, ...]:
    """Return the names of an arm's joints in chain order."""
    return tuple(f"{arm}_joint_{axis}" for axis in AXES)


def actuator_names(arm: str) -> tuple[str, ...]:
    """Return the names of the twin's servos in chain order."""
    return tuple(f"{arm}_servo_{axis}" for axis in AXES)


def finger_names(arm: str) -> tuple[str, str]:
    """Return the names of the fingers' joints, which are those of their servos in the twin."""
    return f"{arm}_finger_a", f"{arm}_finger_b"


def link_name(arm: str, link: int | str) -> str:
    """Return the name of the body or URDF link that a `LinkShape` belongs to."""
    return BODY if link == 0 else f"{arm}_link_{AXES[link - 1]}" if isinstance(link, int) else f"{arm}_{link}"


def _matrix(placement: Placement) -> Float[np.ndarray, "4 4"]:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_euler("xyz", placement[1]).as_matrix(), placement[0]
    return matrix


@functools.lru_cache(maxsize=2)
def _fixed(arm: str) -> tuple[Float[np.ndarray, "4 4"], ...]:
    return (*(_matrix(placement) for placement in (BASE[arm], *LINKS)), _matrix(HAND) @ tip_matrix())


def tip_matrix() -> Float[np.ndarray, "4 4"]:
    """Return the TCP in tool0."""
    return _matrix((TCP, (0, 0, 0)))


def link_poses(arm: str, joints: Joints) -> Float[np.ndarray, "8 4 4"]:
    """Return the frames of the seven links in chain order, then of the TCP, in the robot's base frame."""
    *fixed, tip = _fixed(arm)
    poses, pose = np.empty((8, 4, 4)), np.eye(4)
    for i, (matrix, cos, sin) in enumerate(zip(fixed, np.cos(joints), np.sin(joints), strict=True)):
        pose = pose @ matrix
        x, y = pose[:, 0].copy(), pose[:, 1].copy()
        pose[:, 0], pose[:, 1] = cos * x + sin * y, cos * y - sin * x
        poses[i] = pose
    poses[7] = pose @ tip
    return poses


def forward(arm: str, joints: Joints) -> RigidTransform:
    """Return the TCP in the robot's base frame."""
    return RigidTransform.from_matrix(link_poses(arm, np.asarray(joints, float))[7])


def flange(arm: str, joints: Joints) -> RigidTransform:
    """Return tool0 in the robot's base frame."""
    return forward(arm, joints) * RigidTransform.from_matrix(tip_matrix()).inv()


def points(arm: str, joints: Joints) -> dict[str, Point]:
    """Return points whose place is bounded, for `safety.Rules`: finger tips, wrist and elbow, in the base frame."""
    poses = link_poses(arm, np.asarray(joints, float))
    return {"tcp": poses[7, :3, 3], "wrist": poses[5, :3, 3], "elbow": poses[3, :3, 3]}


HOME = dict(CALIBRATION)
