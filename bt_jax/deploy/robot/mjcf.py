"""The parts of a robot in an MJCF, for MuJoCo: bodies, shapes, servos and grippers."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bt_jax.deploy.robot.model import ArmModel, RobotModel
from bt_jax.deploy.robot.shapes import Box, Capsule, Hull, LinkShape, Placement, Vec3

__all__ = ["add_to_mjcf"]

BODY_MASS = 30.0  # it does not move
DAMPING = 0.02  # of a joint's servo, as a share of its stiffness, s


def add_to_mjcf(robot: RobotModel, root: ET.Element, position: Vec3) -> None:
    """Add a robot, its servos and its grippers to an MJCF tree; `position` is that of its base in the world. The arms
    touch each other and everything else; links of one arm touch where they may meet."""
    body = ET.SubElement(_section(root, "worldbody"), "body", name=robot.body, pos=_text(position))
    _add_shapes(body, list(robot.shapes), BODY_MASS, root)
    for arm in robot.arms:
        _add_gripper(arm, _add_links(arm, body, root), root)
        _exclude(arm, robot.body, _section(root, "contact"))


def _add_links(arm: ArmModel, parent: ET.Element, root: ET.Element) -> ET.Element:
    """Add the moving links of an arm; return the last."""
    actuators = _section(root, "actuator")
    for i, joint in enumerate(arm.joints):
        parent = _body(parent, arm.link_names[i], joint.placement)
        _joint(parent, arm.joint_names[i], "hinge", "0 0 1", joint.lower, joint.upper, joint.armature)
        _add_shapes(parent, [shape for shape in arm.shapes if shape.link == i + 1], joint.mass, root)
        _servo(actuators, arm.actuator_names[i], arm.joint_names[i], joint.stiffness, DAMPING * joint.stiffness)
    return parent


def _add_gripper(arm: ArmModel, last: ET.Element, root: ET.Element) -> None:
    gripper, hand = arm.gripper, _body(last, f"{arm.name}_hand", arm.hand)
    _add_shapes(hand, [shape for shape in arm.shapes if shape.link == "hand"], gripper.mass, root)
    ET.SubElement(hand, "site", name=f"{arm.name}_tool0", rgba="0 0 0 0")
    ET.SubElement(hand, "site", name=f"{arm.name}_tcp", pos=_text(arm.tcp), rgba="0 0 0 0")
    for name, placement, link in zip(arm.finger_names, gripper.fingers, ("finger_a", "finger_b"), strict=True):
        finger = _body(hand, name, placement)
        _joint(finger, name, "slide", "-1 0 0", 0.0, gripper.stroke, gripper.finger_armature)
        _add_shapes(finger, [shape for shape in arm.shapes if shape.link == link], gripper.finger_mass, root)
        _servo(_section(root, "actuator"), name, name, gripper.stiffness, gripper.damping)
    first, second = arm.finger_names
    ET.SubElement(_section(root, "equality"), "joint", joint1=first, joint2=second, solref="0.004 1")


def _exclude(arm: ArmModel, body: str, contact: ET.Element) -> None:
    """Let links that cannot meet not touch."""
    links = (0, *arm.links)
    for k, first in enumerate(links):
        for second in links[k + 1 :]:
            if not arm.may_meet(first, second):
                names = [body if link == 0 else arm.link_name(link) for link in (first, second)]
                ET.SubElement(contact, "exclude", body1=names[0], body2=names[1])


def _section(root: ET.Element, name: str) -> ET.Element:
    found = root.find(name)
    return ET.SubElement(root, name) if found is None else found


def _body(parent: ET.Element, name: str, placement: Placement) -> ET.Element:
    quaternion = Rotation.from_euler("xyz", placement[1]).as_quat(scalar_first=True)
    return ET.SubElement(parent, "body", name=name, pos=_text(placement[0]), quat=_text(quaternion), gravcomp="1")


def _joint(body: ET.Element, name: str, kind: str, axis: str, lower: float, upper: float, armature: float) -> None:
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


def _add_shapes(body: ET.Element, shapes: list[LinkShape], mass: float, root: ET.Element) -> None:
    for i, shape in enumerate(shapes):
        geom = {"contype": "1", "conaffinity": "1", "material": "scene/rubber" if shape.dark else "scene/shell"}
        geom |= {"condim": "4", "friction": "1.2 .01 .0001", "solref": ".004 1", "priority": "1"} if shape.pad else {}
        geom["mass"] = repr(mass / len(shapes))
        match shape.solid:
            case Box(centre, edges):
                geom |= {"type": "box", "pos": _text(centre), "size": _text(np.array(edges) / 2)}
            case Capsule(start, end, radius):
                geom |= {"type": "capsule", "fromto": _text((*start, *end)), "size": repr(radius)}
            case Hull(corners):
                name = f"{body.get('name')}_{i}"
                ET.SubElement(_section(root, "asset"), "mesh", name=name, vertex=_text(np.ravel(corners)))
                geom |= {"type": "mesh", "mesh": name}
        ET.SubElement(body, "geom", geom)


def _text(values: Iterable[Any]) -> str:
    return " ".join(repr(float(value)) for value in values)
