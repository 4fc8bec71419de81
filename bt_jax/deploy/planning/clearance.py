"""How far arms and what they carry are from each other and from the cell: Pinocchio and Coal on the shapes of `yumi`.

Pairs that are meant to touch (a finger and the box that it grasps, a box and what it is set down on) are told by name.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Mapping

import coal
import numpy as np
import pinocchio as pin
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy import yumi
from bt_jax.deploy.yumi import Joints
from bt_jax.deploy.yumi_models import urdf
from bt_jax.tasks import Task

__all__ = ["Carried", "CellClearance", "SafetyClearance"]

CHAIN = {"hand": 8, "finger_a": 9, "finger_b": 9}
FAR = RigidTransform.from_translation([0, 0, -50.0])  # of what is not there
ARM_MARGIN = 0.01  # m between arms, and between an arm and the body
WORLD_MARGIN = 0.004  # m between an arm and tables, kit and boxes
CARRIED_MARGIN = 0.006  # m between a carried box and anything else


@dataclasses.dataclass(frozen=True)
class Carried:
    """A box in a gripper; `pose` in the TCP's frame."""

    arm: str
    box: str
    pose: RigidTransform


class CellClearance:
    """Distances in a cell, for the joints of all arms by name. Poses are in the robot's base frame."""

    def __init__(self, task: Task, *, movable: bool = True) -> None:
        self.task = task
        self._model = pin.buildModelFromXML(urdf())
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._columns = {
            arm: [self._column(name) for name in yumi.joint_names(arm)]
            + [self._column(f"{name}_joint") for name in yumi.finger_names(arm)]
            for arm in yumi.ARMS
        }
        self._geometry = pin.GeometryModel()
        self._kind: list[tuple[str, int]] = []  # (arm or "body" or name, chain index) of each geometry
        self._add_robot()
        self._add_tables()
        self._parts: dict[str, list[tuple[int, RigidTransform]]] = {}  # movable things: geometries and where in them
        self._held: dict[tuple[str, str], int] = {}
        if movable:
            self._add_movable()
        self._pairs = self._add_pairs()
        self._geometry_data = pin.GeometryData(self._geometry)
        self._margins = np.array([self._margin(*pair) for pair in self._pairs])
        self._active = np.ones(len(self._pairs), bool)
        self.place({})

    def place(
        self,
        poses: Mapping[str, RigidTransform],
        *,
        carried: Carried | None = None,
        gripped: str | None = None,
        supports: Iterable[str] = (),
    ) -> None:
        """Say where kit and boxes are; what is not named is nowhere. A carried box is where its gripper is. Hands may touch
        the box `gripped`, and the carried box may touch what is in `supports`."""
        supports, inactive = set(supports), set()
        for name, parts in self._parts.items():
            there = name in poses and (carried is None or carried.box != name)
            for index, offset in parts:
                self._geometry.geometryObjects[index].placement = _se3(poses[name] * offset if there else FAR)
                if not there:
                    inactive.add(index)
        for (arm, box), index in self._held.items():
            if carried is not None and (carried.arm, carried.box) == (arm, box):
                tcp = self._model.frames[self._model.getFrameId(f"{arm}_tcp")].placement
                self._geometry.geometryObjects[index].placement = tcp * _se3(carried.pose)
            else:
                inactive.add(index)
        for k, (i, j) in enumerate(self._pairs):
            active = i not in inactive and j not in inactive and not self._may_touch(i, j, gripped, supports)
            if active != self._active[k]:
                self._active[k] = active
                change = (
                    self._geometry_data.activateCollisionPair if active else self._geometry_data.deactivateCollisionPair
                )
                change(k)

    def distance(self, joints: Mapping[str, Joints], *, opening: float = yumi.OPENING) -> float:
        """Return the least distance [m], negative if something overlaps; inf if there are no pairs."""
        return self._least(joints, opening)[0]

    def slack(self, joints: Mapping[str, Joints], *, opening: float = yumi.OPENING) -> float:
        """Return the least of each pair's distance less the margin that it should keep [m]."""
        return self._least(joints, opening)[1]

    def slacks(self, joints: Mapping[str, Joints], *, opening: float = yumi.OPENING) -> Float[np.ndarray, " pairs"]:
        """Each pair's distance less the margin that it should keep [m]; inf where a pair does not count."""
        return self._distances(joints, opening) - self._margins

    def nearest(self, joints: Mapping[str, Joints], *, opening: float = yumi.OPENING) -> str:
        """Which two shapes are nearest to what they may be, for messages."""
        _, slack, pair = self._least(joints, opening)
        i, j = self._pairs[pair]
        names = [self._geometry.geometryObjects[k].name.rsplit(":", 1)[0] for k in (i, j)]
        return f"{names[0]} and {names[1]} ({1000 * slack:.0f} mm)"

    def _least(self, joints: Mapping[str, Joints], opening: float) -> tuple[float, float, int]:
        found = self._distances(joints, opening)
        slack = found - self._margins
        worst = int(np.argmin(slack))
        return float(found.min()), float(slack[worst]), worst

    def _distances(self, joints: Mapping[str, Joints], opening: float) -> Float[np.ndarray, " pairs"]:
        for arm, columns in self._columns.items():
            self._q[columns] = (*joints[arm], opening / 2, opening / 2)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, self._q)
        pin.computeDistances(self._geometry, self._geometry_data)
        found = np.array([result.min_distance for result in self._geometry_data.distanceResults])
        found[~self._active] = np.inf
        return found

    def _column(self, joint: str) -> int:
        return self._model.joints[self._model.getJointId(joint)].idx_q

    def _add(
        self, name: str, frame: int, placement: RigidTransform, shape: coal.ShapeBase, kind: tuple[str, int]
    ) -> int:
        joint = self._model.frames[frame].parentJoint
        inside = self._model.frames[frame].placement * _se3(placement)
        self._kind.append(kind)
        return self._geometry.addGeometryObject(pin.GeometryObject(name, joint, frame, inside, shape))

    def _add_robot(self) -> None:
        for arm in yumi.ARMS:
            for i, shape in enumerate(yumi.SHAPES):
                if shape.link == 0 and arm != yumi.ARMS[0]:
                    continue
                name = yumi.link_name(arm, shape.link)
                index = shape.link if isinstance(shape.link, int) else CHAIN[shape.link]
                kind = ("body", 0) if shape.link == 0 else (arm, index)
                self._add(f"{name}:{i}", self._model.getFrameId(name), shape.placement, _shape(shape), kind)

    def _add_tables(self) -> None:
        base, root = RigidTransform.from_translation(self.task.robot_position).inv(), self._model.getFrameId(yumi.BODY)
        for table in self.task.tables:
            placement = base * RigidTransform.from_translation(table.position)
            self._add(f"{table.name}:0", root, placement, coal.Box(*table.size), (table.name, -1))

    def _add_movable(self) -> None:
        root, kit = self._model.getFrameId(yumi.BODY), self.task.kit
        half, high = kit.size / 2, kit.thickness / 2 + kit.wall_height / 2
        edge = half - kit.wall_thickness / 2
        parts: list[tuple[yumi.Vec3, yumi.Vec3]] = [((0, 0, 0), (kit.size, kit.size, kit.thickness))]
        parts += [((s * edge, 0, high), (kit.wall_thickness, kit.size, kit.wall_height)) for s in (-1, 1)]
        parts += [((0, s * edge, high), (kit.size, kit.wall_thickness, kit.wall_height)) for s in (-1, 1)]
        things = {kit.name: parts} | {box.name: [((0, 0, 0), (box.size,) * 3)] for box in self.task.boxes}
        for name, shapes in things.items():
            self._parts[name] = [
                (self._add(f"{name}:{i}", root, FAR, coal.Box(*size), (name, -1)), RigidTransform.from_translation(at))
                for i, (at, size) in enumerate(shapes)
            ]
        for arm in yumi.ARMS:
            hand = self._model.getFrameId(f"{arm}_hand")
            for box in self.task.boxes:
                shape, kind = coal.Box(*(box.size,) * 3), (f"{arm} held", 10)
                self._held[arm, box.name] = self._add(f"{box.name} in hand:{arm}", hand, FAR, shape, kind)

    def _add_pairs(self) -> list[tuple[int, int]]:
        count = len(self._kind)
        pairs = [
            (i, j) for i in range(count) for j in range(i + 1, count) if self._wanted(self._kind[i], self._kind[j])
        ]
        for i, j in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        return pairs

    def _wanted(self, first: tuple[str, int], second: tuple[str, int]) -> bool:
        (a, i), (b, j) = sorted((first, second), key=lambda kind: -kind[1])
        if i <= 0:
            return False  # neither moves
        if i == 10:
            return j < 0 or (j > 0 and not a.startswith(b) and j != 10) or b == "body"
        if a == b:
            return i - j >= yumi.OWN_APART
        if b == "body":
            return i >= yumi.BODY_APART
        return i >= 3 if j < 0 else True

    def _margin(self, i: int, j: int) -> float:
        indices = (self._kind[i][1], self._kind[j][1])
        if 10 in indices:
            return CARRIED_MARGIN
        return WORLD_MARGIN if min(indices) < 0 else ARM_MARGIN

    def _may_touch(self, i: int, j: int, gripped: str | None, supports: set[str]) -> bool:
        for (name, index), (_, other) in ((self._kind[i], self._kind[j]), (self._kind[j], self._kind[i])):
            if index < 0 and ((other in (8, 9) and name == gripped) or (other == 10 and name in supports)):
                return True
        return False


@dataclasses.dataclass(frozen=True)
class SafetyClearance:
    """Picklable factory for `safety.Rules.clearance_of`: arms against each other, the body and the tables; what
    perception sees has no part in it."""

    task: Task

    def __call__(self) -> Callable[[Mapping[str, Joints]], float]:
        return CellClearance(self.task, movable=False).distance


def _shape(shape: yumi.LinkShape) -> coal.ShapeBase:
    return coal.Box(*shape.end) if shape.kind == "box" else coal.Capsule(shape.radius, shape.length)


def _se3(pose: RigidTransform) -> pin.SE3:
    return pin.SE3(pose.as_matrix())
