"""The models of a YuMi that are made from its table: URDF for Pinocchio, MJCF for MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bt_jax.deploy.yumi import (
    ARMS,
    BASE,
    BODY,
    BODY_APART,
    FINGERS,
    HAND,
    LINKS,
    LOWER,
    OWN_APART,
    SHAPES,
    SPEED,
    STROKE,
    TCP,
    UPPER,
    LinkShape,
    Placement,
    Vec3,
    actuator_names,
    finger_names,
    joint_names,
    link_name,
)

__all__ = ["add_to_mjcf", "urdf"]

MASSES = (1.5, 1.3, 1.0, 0.9, 0.6, 0.4, 0.1)  # kg, our estimate; the servos carry them
HAND_MASS, FINGER_MASS = 0.2, 0.02
ARMATURE = (0.3, 0.3, 0.2, 0.2, 0.08, 0.08, 0.05)  # kg m2, of the geared motors: our estimate
STIFFNESS = (6000.0, 6000.0, 4000.0, 4000.0, 1600.0, 1600.0, 1000.0)  # Nm/rad
FINGER_STIFFNESS = 4000.0  # N/m


def _links(arm: str) -> list[tuple[str, str, Placement]]:
    """Return name, parent and placement of the moving links of an arm in chain order."""
    parents = [BODY, *(link_name(arm, i) for i in range(1, 7))]
    return list(zip([link_name(arm, i) for i in range(1, 8)], parents, (BASE[arm], *LINKS), strict=True))


def urdf(arms: tuple[str, ...] = ARMS, *, fingers: bool = True) -> str:
    """Return the URDF of the given arms with frames `{arm}_hand` (tool0), `{arm}_tcp`; 7 joints an arm without `fingers`."""
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
    """Add the robot, its servos and its grippers to an MJCF tree; `position` is that of its base in the world. The arms
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
