"""The URDF of a robot, for Pinocchio."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any

from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import Placement

__all__ = ["urdf"]


def urdf(robot: RobotModel, arms: Iterable[str] | None = None, *, fingers: bool = True) -> str:
    """Return the URDF of the given arms, of all by default, with frames `{arm}_hand` (tool0) and `{arm}_tcp`; without
    `fingers` the arms' own joints are all that move."""
    root = ET.Element("robot", name=robot.name)
    ET.SubElement(root, "link", name=robot.body)
    for arm in map(robot.arm, robot.arm_names if arms is None else arms):
        parents = (robot.body, *arm.link_names)
        for joint, name, parent, link in zip(arm.joints, arm.joint_names, parents, arm.link_names, strict=False):
            bounds = {"lower": joint.lower, "upper": joint.upper, "velocity": joint.speed, "effort": 100}
            _joint(root, name, "revolute", parent, link, joint.placement, "0 0 1", bounds)
        hand, gripper = f"{arm.name}_hand", arm.gripper
        _joint(root, f"{arm.name}_mount", "fixed", arm.link_names[-1], hand, arm.hand)
        _joint(root, f"{arm.name}_tip", "fixed", hand, f"{arm.name}_tcp", (arm.tcp, (0, 0, 0)))
        for name, placement in zip(arm.finger_names, gripper.fingers if fingers else (), strict=fingers):
            bounds = {"lower": 0, "upper": gripper.stroke, "velocity": gripper.speed, "effort": gripper.force}
            _joint(root, f"{name}_joint", "prismatic", hand, name, placement, "-1 0 0", bounds)
    return ET.tostring(root, encoding="unicode")


def _joint(
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


def _text(values: Iterable[Any]) -> str:
    return " ".join(repr(float(value)) for value in values)
