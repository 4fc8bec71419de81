"""How far arms and what they carry are from each other and from the cell: Pinocchio and Coal on the shapes of the robot.

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

from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import LinkShape, Vec3
from bt_jax.deploy.robot.urdf import urdf
from bt_jax.tasks import Task

__all__ = ["Carried", "CellClearance", "SafetyClearance"]

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


@dataclasses.dataclass(frozen=True)
class _Part:
    """What a shape belongs to: `kind` is "body", "link", "hand", "finger", "held" (a box in a hand) or "thing" (of the
    cell); `owner` the arm, or the thing's name; `place` that in the arm's chain."""

    kind: str
    owner: str = ""
    place: int = 0

    @property
    def gripping(self) -> bool:
        """May it touch a box that is grasped?"""
        return self.kind in ("hand", "finger")


class CellClearance:
    """Distances in a cell, for the joints of all arms by name; grippers are open unless their `opening` [m] is given. Poses
    are in the robot's base frame."""

    def __init__(self, robot: RobotModel, task: Task, *, movable: bool = True) -> None:
        self.robot, self.task = robot, task
        self._model = pin.buildModelFromXML(urdf(robot))
        self._data = self._model.createData()
        self._q = pin.neutral(self._model)
        self._columns = {
            arm.name: [self._column(name) for name in arm.joint_names]
            + [self._column(f"{name}_joint") for name in arm.finger_names]
            for arm in robot.arms
        }
        self._geometry = pin.GeometryModel()
        self._of: list[_Part] = []  # of each geometry
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

    def distance(self, joints: Mapping[str, Joints], *, opening: float | None = None) -> float:
        """Return the least distance [m], negative if something overlaps; inf if there are no pairs."""
        return self._least(joints, opening)[0]

    def slack(self, joints: Mapping[str, Joints], *, opening: float | None = None) -> float:
        """Return the least of each pair's distance less the margin that it should keep [m]."""
        return self._least(joints, opening)[1]

    def slacks(self, joints: Mapping[str, Joints], *, opening: float | None = None) -> Float[np.ndarray, " pairs"]:
        """Each pair's distance less the margin that it should keep [m]; inf where a pair does not count."""
        return self._distances(joints, opening) - self._margins

    def nearest(self, joints: Mapping[str, Joints], *, opening: float | None = None) -> str:
        """Which two shapes are nearest to what they may be, for messages."""
        _, slack, pair = self._least(joints, opening)
        i, j = self._pairs[pair]
        names = [self._geometry.geometryObjects[k].name.rsplit(":", 1)[0] for k in (i, j)]
        return f"{names[0]} and {names[1]} ({1000 * slack:.0f} mm)"

    def _least(self, joints: Mapping[str, Joints], opening: float | None) -> tuple[float, float, int]:
        found = self._distances(joints, opening)
        slack = found - self._margins
        worst = int(np.argmin(slack))
        return float(found.min()), float(slack[worst]), worst

    def _distances(self, joints: Mapping[str, Joints], opening: float | None) -> Float[np.ndarray, " pairs"]:
        for arm, columns in self._columns.items():
            finger = self.robot.arm(arm).gripper.stroke if opening is None else opening / 2
            self._q[columns] = (*joints[arm], finger, finger)
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, self._q)
        pin.computeDistances(self._geometry, self._geometry_data)
        found = np.array([result.min_distance for result in self._geometry_data.distanceResults])
        found[~self._active] = np.inf
        return found

    def _column(self, joint: str) -> int:
        return self._model.joints[self._model.getJointId(joint)].idx_q

    def _add(self, name: str, frame: int, placement: RigidTransform, shape: coal.ShapeBase, part: _Part) -> int:
        joint = self._model.frames[frame].parentJoint
        inside = self._model.frames[frame].placement * _se3(placement)
        self._of.append(part)
        return self._geometry.addGeometryObject(pin.GeometryObject(name, joint, frame, inside, shape))

    def _add_robot(self) -> None:
        body, root = self.robot.body, self._model.getFrameId(self.robot.body)
        for i, shape in enumerate(self.robot.shapes):
            self._add(f"{body}:{i}", root, shape.placement, _shape(shape), _Part("body"))
        for arm in self.robot.arms:
            for i, shape in enumerate(arm.shapes):
                name = arm.link_name(shape.link)
                kind = "link" if isinstance(shape.link, int) else shape.link.split("_")[0]
                part = _Part(kind, arm.name, arm.place_in_chain(shape.link))
                self._add(f"{name}:{i}", self._model.getFrameId(name), shape.placement, _shape(shape), part)

    def _add_tables(self) -> None:
        base, root = (
            RigidTransform.from_translation(self.task.robot_position).inv(),
            self._model.getFrameId(self.robot.body),
        )
        for table in self.task.tables:
            placement = base * RigidTransform.from_translation(table.position)
            self._add(f"{table.name}:0", root, placement, coal.Box(*table.size), _Part("thing", table.name))

    def _add_movable(self) -> None:
        root, kit = self._model.getFrameId(self.robot.body), self.task.kit
        half, high = kit.size / 2, kit.thickness / 2 + kit.wall_height / 2
        edge = half - kit.wall_thickness / 2
        parts: list[tuple[Vec3, Vec3]] = [((0, 0, 0), (kit.size, kit.size, kit.thickness))]
        parts += [((s * edge, 0, high), (kit.wall_thickness, kit.size, kit.wall_height)) for s in (-1, 1)]
        parts += [((0, s * edge, high), (kit.size, kit.wall_thickness, kit.wall_height)) for s in (-1, 1)]
        things = {kit.name: parts} | {box.name: [((0, 0, 0), (box.size,) * 3)] for box in self.task.boxes}
        for name, shapes in things.items():
            self._parts[name] = [
                (
                    self._add(f"{name}:{i}", root, FAR, coal.Box(*size), _Part("thing", name)),
                    RigidTransform.from_translation(at),
                )
                for i, (at, size) in enumerate(shapes)
            ]
        for arm in self.robot.arm_names:
            hand = self._model.getFrameId(f"{arm}_hand")
            for box in self.task.boxes:
                shape, part = coal.Box(*(box.size,) * 3), _Part("held", arm)
                self._held[arm, box.name] = self._add(f"{box.name} in hand:{arm}", hand, FAR, shape, part)

    def _add_pairs(self) -> list[tuple[int, int]]:
        count = len(self._of)
        pairs = [(i, j) for i in range(count) for j in range(i + 1, count) if self._wanted(self._of[i], self._of[j])]
        for i, j in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        return pairs

    def _wanted(self, first: _Part, second: _Part) -> bool:
        """Can they meet, and would it matter?"""
        kinds = (first.kind, second.kind)
        if "held" in kinds:
            held, other = (first, second) if first.kind == "held" else (second, first)
            return other.kind in ("thing", "body") or (other.kind != "held" and other.owner != held.owner)
        on_arm = [part for part in (first, second) if part.kind not in ("body", "thing")]
        if len(on_arm) == 2:
            apart = abs(first.place - second.place)
            return first.owner != second.owner or apart >= self.robot.arm(first.owner).own_apart
        if not on_arm:
            return False
        part, arm = on_arm[0], self.robot.arm(on_arm[0].owner)
        return part.place >= (arm.body_apart if "body" in kinds else arm.cell_apart)

    def _margin(self, i: int, j: int) -> float:
        kinds = (self._of[i].kind, self._of[j].kind)
        if "held" in kinds:
            return CARRIED_MARGIN
        return WORLD_MARGIN if "thing" in kinds else ARM_MARGIN

    def _may_touch(self, i: int, j: int, gripped: str | None, supports: set[str]) -> bool:
        for thing, other in ((self._of[i], self._of[j]), (self._of[j], self._of[i])):
            if thing.kind == "thing" and (
                (other.gripping and thing.owner == gripped) or (other.kind == "held" and thing.owner in supports)
            ):
                return True
        return False


@dataclasses.dataclass(frozen=True)
class SafetyClearance:
    """Picklable factory for `safety.Rules.clearance_of`: arms against each other, the body and the tables; what
    perception sees has no part in it."""

    robot: RobotModel
    task: Task

    def __call__(self) -> Callable[[Mapping[str, Joints]], float]:
        return CellClearance(self.robot, self.task, movable=False).distance


def _shape(shape: LinkShape) -> coal.ShapeBase:
    return coal.Box(*shape.end) if shape.kind == "box" else coal.Capsule(shape.radius, shape.length)


def _se3(pose: RigidTransform) -> pin.SE3:
    return pin.SE3(pose.as_matrix())
