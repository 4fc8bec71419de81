"""ABB YuMi (IRB 14000) with Smart Grippers: two arms of seven joints.

The joints are ABB's nominal ones; the shapes are primitives of our own around the links, a little larger than the links.
Masses, armatures and stiffnesses are our estimates: the servos carry them.
"""

from __future__ import annotations

import numpy as np

from bt_jax.deploy.robot.model import ArmModel, GripperModel, JointModel, RobotModel
from bt_jax.deploy.robot.shapes import LinkShape, Placement

__all__ = ["YUMI"]

QUARTER = np.pi / 2
BASE: dict[str, Placement] = {
    "left": ((0.053711, 0.072573, 0.415010), (0.979068, -0.569211, 2.316178)),
    "right": ((0.053711, -0.072573, 0.415010), (-0.979068, -0.569211, -2.316178)),
}
AXES = (1, 2, 7, 3, 4, 5, 6)  # ABB's numbers in chain order
LINKS: tuple[Placement, ...] = (  # of each joint after the first in the link before it
    ((0.03, 0, 0.1), (QUARTER, 0, 0)),
    ((-0.03, 0.1725, 0), (-QUARTER, 0, 0)),
    ((-0.0405, 0, 0.079), (QUARTER, -QUARTER, 0)),
    ((0.0405, 0.1645, 0), (-QUARTER, 0, 0)),
    ((-0.027, 0, 0.1005), (QUARTER, 0, 0)),
    ((0.027, 0.029, 0), (-QUARTER, 0, 0)),
)
LOWER = np.radians([-168.5, -143.5, -168.5, -123.5, -290, -88, -229]).tolist()
UPPER = np.radians([168.5, 43.5, 168.5, 80, 290, 138, 229]).tolist()
SPEED = np.radians([180, 180, 180, 180, 400, 400, 400]).tolist()
ACCELERATION = (
    20.0,
) * 7  # rad/s2; an estimate, since ABB names that of the tool only: 11 m/s2, here at the reach of 0.56 m
WEIGHTS = (1.0, 1.0, 0.8, 0.8, 0.3, 0.4, 0.2)
MASSES = (1.5, 1.3, 1.0, 0.9, 0.6, 0.4, 0.1)
ARMATURE = (0.3, 0.3, 0.2, 0.2, 0.08, 0.08, 0.05)
STIFFNESS = (6000.0, 6000.0, 4000.0, 4000.0, 1600.0, 1600.0, 1000.0)

CALIBRATION = {
    arm: np.radians([0, -130, sign * 135, 30, 0, 40, 0]).tolist() for arm, sign in (("left", 1), ("right", -1))
}
"""ABB's calibration pose in chain order."""

SMART_GRIPPER = GripperModel(
    stroke=0.025,
    fingers=(((0, -0.0065, 0.0837), (0, 0, 0)), ((0, 0.0065, 0.0837), (0, 0, np.pi))),
    force=20.0,
    speed=0.025,
)


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
BODY_SHAPES = (
    LinkShape(0, "box", (-0.06, 0, 0.19), (0.2, 0.2, 0.36)),
    LinkShape(0, "box", (-0.01, 0, 0.42), (0.16, 0.12, 0.16)),
)
ARM_SHAPES = (
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


def _arm(name: str) -> ArmModel:
    columns = zip(
        AXES, (BASE[name], *LINKS), LOWER, UPPER, SPEED, WEIGHTS, MASSES, ARMATURE, STIFFNESS, ACCELERATION, strict=True
    )
    return ArmModel(
        name=name,
        joints=tuple(JointModel(str(axis), *rest) for axis, *rest in columns),
        hand=((0, 0, 0.007), (0, 0, np.pi)),  # tool0, where the gripper begins
        tcp=(0, 0, 0.13),
        gripper=SMART_GRIPPER,
        home=tuple(CALIBRATION[name]),
        shapes=ARM_SHAPES,
        landmarks=(("wrist", 6), ("elbow", 4)),
        own_apart=5,
        body_apart=4,
        cell_apart=3,
        payload=0.5,
    )


YUMI = RobotModel("yumi", (_arm("left"), _arm("right")), ((-0.2, -0.8, 0.0), (0.8, 0.8, 1.2)), BODY_SHAPES)
