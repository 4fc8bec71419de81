"""ABB YuMi (IRB 14000) with Smart Grippers: two arms of seven joints.

The joints are ABB's nominal ones. The shapes are convex hulls around points on the surface of public coarse meshes, made by
`benchmarks/collision_shapes.py`, which also found by sampling which pairs of links never meet and which always nearly touch.
Masses, armatures and stiffnesses are our estimates: the servos carry them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from bt_jax.deploy.robot.model import ArmModel, GripperModel, JointModel, RobotModel
from bt_jax.deploy.robot.shapes import Box, Hull, Link, LinkShape, Placement

__all__ = ["SHAPES_FILE", "YUMI"]

SHAPES_FILE = Path(__file__).with_name("yumi_shapes.json")
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


DARK = {3, 5, 7, "finger_a", "finger_b"}
PAD = Box((-0.001, 0.0065, 0.0405), (0.002, 0.012, 0.02))  # of a finger; its face is where the fingers meet


def _link(name: str) -> Link:
    """Return the link that a name of `SHAPES_FILE` means."""
    return 0 if name == "body" else int(name[5:]) if name.startswith("link_") else name


def _shapes(table: Mapping[str, list[list[list[float]]]]) -> list[LinkShape]:
    """Return the shapes of the body and of an arm."""
    shapes = []
    for name, hulls in table.items():
        for link in ("finger_a", "finger_b") if name == "finger" else (_link(name),):
            solids = [Hull(tuple((x, y, z) for x, y, z in corners)) for corners in hulls]
            shapes += [LinkShape(link, solid, dark=link in DARK) for solid in solids]
            shapes += [LinkShape(link, PAD, dark=True, pad=True)] if name == "finger" else []
    return shapes


_TABLE = json.loads(SHAPES_FILE.read_text(encoding="utf-8"))
SHAPES = _shapes(_TABLE["hulls"])
UNCHECKED = tuple((_link(a), _link(b)) for a, b in (*_TABLE["never"], *_TABLE["always"]))


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
        shapes=tuple(shape for shape in SHAPES if shape.link != 0),
        landmarks=(("wrist", 6), ("elbow", 4)),
        payload=0.5,
        unchecked=UNCHECKED,
    )


BODY_SHAPES = tuple(shape for shape in SHAPES if shape.link == 0)
YUMI = RobotModel(
    "yumi", (_arm("left"), _arm("right")), ((-0.2, -0.8, 0.0), (0.8, 0.8, 1.2)), BODY_SHAPES, "yumi_stack"
)
