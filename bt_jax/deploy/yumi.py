"""ABB YuMi (IRB 14000) from one table: URDF for Pinocchio, MJCF for MuJoCo, and forward kinematics in NumPy.

The joints are ABB's nominal ones; the shapes are primitives of our own around the links, a little larger than the links. The
chain order of the seven axes is ABB's 1, 2, 7, 3, 4, 5, 6. All axes turn about the z of their frames. Lengths in metres,
angles in radians.
"""

from __future__ import annotations

import dataclasses
import functools
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

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
    "add_to_mjcf",
    "finger_names",
    "flange",
    "forward",
    "joint_names",
    "link_name",
    "link_poses",
    "points",
    "tip_matrix",
    "urdf",
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
MASSES = (1.5, 1.3, 1.0, 0.9, 0.6, 0.4, 0.1)  # kg, our estimate; the servos carry them
OWN_APART, BODY_APART = 5, 4  # links that are less far apart in the chain cannot meet (or always overlap)
HAND_MASS, FINGER_MASS = 0.2, 0.02
ARMATURE = (0.3, 0.3, 0.2, 0.2, 0.08, 0.08, 0.05)  # kg m2, of the geared motors: our estimate
STIFFNESS = (6000.0, 6000.0, 4000.0, 4000.0, 1600.0, 1600.0, 1000.0)  # Nm/rad
FINGER_STIFFNESS = 4000.0  # N/m

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
    """In chain order."""
    return tuple(f"{arm}_joint_{axis}" for axis in AXES)


def actuator_names(arm: str) -> tuple[str, ...]:
    """Of the twin's servos, in chain order."""
    return tuple(f"{arm}_servo_{axis}" for axis in AXES)


def finger_names(arm: str) -> tuple[str, str]:
    """Of the fingers' joints, and of their servos in the twin."""
    return f"{arm}_finger_a", f"{arm}_finger_b"


def link_name(arm: str, link: int | str) -> str:
    """Of the body or URDF link that a `LinkShape` belongs to."""
    return BODY if link == 0 else f"{arm}_link_{AXES[link - 1]}" if isinstance(link, int) else f"{arm}_{link}"


def _links(arm: str) -> list[tuple[str, str, Placement]]:
    """Name, parent and placement of the moving links of an arm in chain order."""
    parents = [BODY, *(link_name(arm, i) for i in range(1, 7))]
    return list(zip([link_name(arm, i) for i in range(1, 8)], parents, (BASE[arm], *LINKS), strict=True))


def urdf(arms: tuple[str, ...] = ARMS, *, fingers: bool = True) -> str:
    """URDF text with the given arms; frames `{arm}_hand` (tool0) and `{arm}_tcp`. Without `fingers`, 7 joints an arm."""
    root = ET.Element("robot", name="yumi")
    ET.SubElement(root, "link", name=BODY)
    for arm in arms:
        for i, (name, parent, placement) in enumerate(_links(arm)):
            bounds = {"lower": LOWER[i], "upper": UPPER[i], "velocity": SPEED[i], "effort": 100}
            _urdf_joint(root, joint_names(arm)[i], "revolute", parent, name, placement, "0 0 1", bounds)
        _urdf_joint(root, f"{arm}_mount", "fixed", link_name(arm, 7), f"{arm}_hand", HAND)
        _urdf_joint(root, f"{arm}_tip", "fixed", f"{arm}_hand", f"{arm}_tcp", (TCP, (0, 0, 0)))
        for name, placement in zip(finger_names(arm), FINGERS if fingers else (), strict=fingers):
            bounds = {"lower": 0, "upper": STROKE, "velocity": STROKE, "effort": 20}
            _urdf_joint(root, f"{name}_joint", "prismatic", f"{arm}_hand", name, placement, "-1 0 0", bounds)
    return ET.tostring(root, encoding="unicode")


def _urdf_joint(
    root: ET.Element,
    name: str,
    kind: str,
    parent: str,
    child: str,
    placement: Placement,
    axis: str | None = None,
    bounds: Mapping[str, float | int] = MappingProxyType({}),
) -> None:
    ET.SubElement(root, "link", name=child)
    joint = ET.SubElement(root, "joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_text(placement[0]), rpy=_text(placement[1]))
    if axis is not None:
        ET.SubElement(joint, "axis", xyz=axis)
        ET.SubElement(joint, "limit", {key: repr(float(value)) for key, value in bounds.items()})


def add_to_mjcf(root: ET.Element, position: Vec3) -> None:
    """Adds the robot, its servos and its grippers to an MJCF tree; `position` is that of its base in the world. The arms
    touch each other and everything else; links of one arm that are near each other in the chain do not."""
    world, actuators, contact = _section(root, "worldbody"), _section(root, "actuator"), _section(root, "contact")
    body = ET.SubElement(world, "body", name=BODY, pos=_text(position))
    _mjcf_shapes(body, [shape for shape in SHAPES if shape.link == 0], None)
    for arm in ARMS:
        parent, names = body, []
        for i, (name, _, placement) in enumerate(_links(arm)):
            parent = _mjcf_body(parent, name, placement)
            names.append(name)
            _mjcf_joint(parent, joint_names(arm)[i], "hinge", "0 0 1", LOWER[i], UPPER[i], ARMATURE[i])
            _mjcf_shapes(parent, [shape for shape in SHAPES if shape.link == i + 1], MASSES[i])
            stiffness = STIFFNESS[i]
            _servo(actuators, actuator_names(arm)[i], joint_names(arm)[i], stiffness, 0.02 * stiffness)
        hand = _mjcf_body(parent, f"{arm}_hand", HAND)
        _mjcf_shapes(hand, [shape for shape in SHAPES if shape.link == "hand"], HAND_MASS)
        ET.SubElement(hand, "site", name=f"{arm}_tool0", rgba="0 0 0 0")
        ET.SubElement(hand, "site", name=f"{arm}_tcp", pos=_text(TCP), rgba="0 0 0 0")
        for name, placement, link in zip(finger_names(arm), FINGERS, ("finger_a", "finger_b"), strict=True):
            finger = _mjcf_body(hand, name, placement)
            _mjcf_joint(finger, name, "slide", "-1 0 0", 0.0, STROKE, 0.2)
            _mjcf_shapes(finger, [shape for shape in SHAPES if shape.link == link], FINGER_MASS)
            _servo(actuators, name, name, FINGER_STIFFNESS, 100.0)
        names += [f"{arm}_hand", *finger_names(arm)]
        first, second = finger_names(arm)
        ET.SubElement(_section(root, "equality"), "joint", joint1=first, joint2=second, solref="0.004 1")
        chain = [(BODY, 0), *((name, min(i, 9)) for i, name in enumerate(names, start=1))]
        for k, (a, i) in enumerate(chain):
            for b, j in chain[k + 1 :]:
                if j - i < (OWN_APART if i else BODY_APART):
                    ET.SubElement(contact, "exclude", body1=a, body2=b)


def _section(root: ET.Element, name: str) -> ET.Element:
    found = root.find(name)
    return ET.SubElement(root, name) if found is None else found


def _mjcf_body(parent: ET.Element, name: str, placement: Placement) -> ET.Element:
    quaternion = Rotation.from_euler("xyz", placement[1]).as_quat(scalar_first=True)
    return ET.SubElement(parent, "body", name=name, pos=_text(placement[0]), quat=_text(quaternion), gravcomp="1")


def _mjcf_joint(body: ET.Element, name: str, kind: str, axis: str, lower: float, upper: float, armature: float) -> None:
    ET.SubElement(
        body,
        "joint",
        name=name,
        type=kind,
        axis=axis,
        range=_text((lower, upper)),
        armature=repr(armature),
        damping="0.5",
    )


def _servo(actuators: ET.Element, name: str, joint: str, stiffness: float, damping: float) -> None:
    ET.SubElement(actuators, "position", name=name, joint=joint, kp=repr(stiffness), kv=repr(damping))


def _mjcf_shapes(body: ET.Element, shapes: list[LinkShape], mass: float | None) -> None:
    for i, shape in enumerate(shapes):
        pad = str(shape.link).startswith("finger") and i == 1
        geom = {"type": shape.kind, "contype": "1", "conaffinity": "1", "material": "rubber" if shape.dark else "shell"}
        geom |= {"condim": "4", "friction": "1.2 .01 .0001", "solref": ".004 1", "priority": "1"} if pad else {}
        geom["mass"] = repr((mass or 30.0) / len(shapes))
        if shape.kind == "box":
            geom |= {"pos": _text(shape.start), "size": _text(np.array(shape.end) / 2)}
        else:
            geom |= {"fromto": _text((*shape.start, *shape.end)), "size": repr(shape.radius)}
        ET.SubElement(body, "geom", geom)


def _text(values: Iterable[Any]) -> str:
    return " ".join(repr(float(value)) for value in values)


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
