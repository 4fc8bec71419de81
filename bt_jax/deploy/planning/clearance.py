"""How far arms and what they carry are from each other and from the cell.

A hand may touch the object that it grasps, which is told by name. What a carried one may touch follows from the place where
it is to rest: things may be as near to it as they are there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.collisions import CollisionModel
from bt_jax.deploy.planning.grasps import release_width
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import Box, Cylinder, Link, Solid
from bt_jax.tasks import Kit, Object, Task

__all__ = ["Carried", "CellClearance", "SafetyClearance"]

HERE = RigidTransform.identity()
ARM_MARGIN = 0.01  # m between arms, and between an arm and the body
WORLD_MARGIN = 0.004  # m between an arm and kits and objects
TABLE_MARGIN = 0.006  # m between an arm and tables: more than `safety.Rules.clearance`, within which a path is rejected
CARRIED_MARGIN = 0.006  # m between a carried box and anything else
SINK = 0.005  # m that a box may overlap at its place with what it rests on, as heights are seen
GRAZE = 0.002  # m that it may overlap with what is beside it there, as boxes side by side are seen
STRAIGHT = 0.001  # m by which a straight way down may be off it
FIXED = ("body", "thing")


@dataclasses.dataclass(frozen=True)
class Carried:
    """What is in a gripper; `pose` in the TCP's frame. Not `known`: something as large as `box`, which may be elsewhere."""

    arm: str
    box: str
    pose: RigidTransform
    known: bool = True


@dataclasses.dataclass(frozen=True)
class _Part:
    """What a shape belongs to: `kind` is "body", "link", "hand", "finger", "held" (a box in a hand) or "thing" (of the
    cell); `owner` the arm, or the thing's name; `link` that of the arm."""

    kind: str
    owner: str = ""
    link: Link = 0

    @property
    def gripping(self) -> bool:
        """May it touch a box that is grasped?"""
        return self.kind in ("hand", "finger")


class CellClearance:
    """Distances in a cell, for the joints of all arms by name. Grippers are open, one that carries something as far as it
    will be to let go of it. Poses are in the robot's base frame."""

    def __init__(self, robot: RobotModel, task: Task, *, movable: bool = True) -> None:
        self.robot, self.task = robot, task
        self._model = CollisionModel(robot)
        self._of: list[_Part] = []  # of each solid
        self._things: dict[str, list[int]] = {}  # the solids of kit and boxes
        self._held: dict[tuple[str, str], int] = {}
        self._add_robot()
        self._add_tables()
        if movable:
            self._add_movable()
        solids = range(len(self._of))
        self._pairs = [(i, j) for i in solids for j in solids[i + 1 :] if self._wanted(self._of[i], self._of[j])]
        self._model.watch(self._pairs)
        self._margins = np.array([self._margin(*pair) for pair in self._pairs])
        self._contacts = np.array([{self._of[i].kind, self._of[j].kind} == {"held", "thing"} for i, j in self._pairs])
        self._active = np.ones(len(self._pairs), bool)
        self._opening: dict[str, float] = {}
        self.place({})

    def place(
        self,
        poses: Mapping[str, RigidTransform],
        *,
        carried: Carried | None = None,
        gripped: str | None = None,
    ) -> None:
        """Say where kit and boxes are; what is not named is nowhere. A carried box is where its gripper is. Hands may touch
        the box `gripped`."""
        self._opening = {}
        if carried is not None and carried.known:
            wide = self.robot.arm(carried.arm).gripper.opening
            self._opening[carried.arm] = release_width(self.task.thing(carried.box), carried.pose, wide)
        inactive = set()
        for name, solids in self._things.items():
            there = name in poses and (carried is None or carried.box != name or not carried.known)
            for solid in solids:
                if there:
                    self._model.place(solid, poses[name])
                else:
                    inactive.add(solid)
        for (arm, box), solid in self._held.items():
            if carried is not None and (carried.arm, carried.box) == (arm, box):
                self._model.place(solid, carried.pose)
            else:
                inactive.add(solid)
        for k, (i, j) in enumerate(self._pairs):
            self._active[k] = not ({i, j} & inactive or self._may_touch(i, j, gripped))

    def distance(self, joints: Mapping[str, Joints]) -> float:
        """Return the least distance [m], negative if something overlaps; inf if there are no pairs."""
        return self._least(joints, np.zeros(len(self._pairs)))[0]

    def slack(self, joints: Mapping[str, Joints]) -> float:
        """Return the least of each pair's distance less the margin that it should keep [m]."""
        return self._least(joints, self._margins)[0]

    def slacks(self, joints: Mapping[str, Joints]) -> Float[np.ndarray, " pairs"]:
        """Return each pair's distance less the margin that it should keep [m], and where that is positive perhaps less of
        it; inf where a pair does not count."""
        found = self._bounds(joints)
        for pair in np.flatnonzero(found < self._margins):  # none where a joint is not a number
            found[pair] = self._model.distance(int(pair))
        return found - self._margins

    def at_rest(self, joints: Mapping[str, Joints], overlap: float) -> Float[np.ndarray, " pairs"]:
        """Return the least slack [m] that each pair needs for the carried box to rest where it is with these joints,
        overlapping with nothing by more than `overlap` [m]; 0 for all pairs without it."""
        return np.where(self._contacts, np.clip(self.slacks(joints) - STRAIGHT, -CARRIED_MARGIN - overlap, 0.0), 0.0)

    def nearest(self, joints: Mapping[str, Joints], allowed: Float[np.ndarray, " pairs"] | float = 0.0) -> str:
        """Which two shapes are nearest to what they may be, for messages; `allowed` is the least slack of each pair [m]."""
        slack, pair = self._least(joints, self._margins + allowed)
        first, second = (self._model.names[solid] for solid in self._pairs[pair])
        return f"{first} and {second} ({1000 * slack:.0f} mm)"

    def _least(self, joints: Mapping[str, Joints], margins: Float[np.ndarray, " pairs"]) -> tuple[float, int]:
        """Return the least of the distances less `margins`, and of which pair it is; NaN if a joint is not a number."""
        bounds = self._bounds(joints) - margins
        least, nearest = np.inf, 0
        if np.isnan(bounds).any():
            return np.nan, nearest
        for pair in np.argsort(bounds):
            if bounds[pair] >= least:
                break
            slack = self._model.distance(int(pair)) - margins[pair]
            if slack < least:
                least, nearest = slack, int(pair)
        return float(least), nearest

    def _bounds(self, joints: Mapping[str, Joints]) -> Float[np.ndarray, " pairs"]:
        """Move the arms; return what each pair is apart at least, inf where it does not count."""
        return np.where(self._active, self._model.move(joints, self._opening), np.inf)

    def _add(self, part: _Part, name: str, link: str, solid: Solid, pose: RigidTransform = HERE) -> int:
        self._of.append(part)
        return self._model.add(name, link, pose, solid)

    def _add_robot(self) -> None:
        for shape in self.robot.shapes:
            self._add(_Part("body"), self.robot.body, self.robot.body, shape.solid)
        for arm in self.robot.arms:
            for shape in arm.shapes:
                name = arm.link_name(shape.link)
                kind = "link" if isinstance(shape.link, int) else shape.link.split("_")[0]
                self._add(_Part(kind, arm.name, shape.link), name, name, shape.solid)

    def _add_tables(self) -> None:
        base = RigidTransform.from_translation(self.task.robot_position).inv()
        for table in self.task.tables:
            pose = base * RigidTransform.from_translation(table.position)
            self._add(_Part("thing", table.name), table.name, self.robot.body, Box((0, 0, 0), table.size), pose)

    def _add_movable(self) -> None:
        kits = {kit.name: _kit_solids(kit) for kit in self.task.kits}
        objects = {thing.name: _solid(thing) for thing in self.task.objects}
        for name, solids in {**kits, **{name: [solid] for name, solid in objects.items()}}.items():
            part = _Part("thing", name)
            self._things[name] = [self._add(part, name, self.robot.body, solid) for solid in solids]
        for arm in self.robot.arm_names:
            for name, solid in objects.items():
                part = _Part("held", arm)
                self._held[arm, name] = self._add(part, f"{name} in hand", f"{arm}_tcp", solid)

    def _wanted(self, first: _Part, second: _Part) -> bool:
        """Can they meet, and would it matter?"""
        kinds = (first.kind, second.kind)
        if "held" in kinds:
            held, other = (first, second) if first.kind == "held" else (second, first)
            arm = self.robot.arm(held.owner)  # in which the box moves as the fingers do
            return other.kind in FIXED or (
                other.kind != "held" and (other.owner != arm.name or arm.may_meet(other.link, "finger_a"))
            )
        if first.kind in FIXED and second.kind in FIXED:
            return False
        if "thing" in kinds or (first.owner != second.owner and "body" not in kinds):
            return True
        arm = self.robot.arm(first.owner or second.owner)
        return arm.may_meet(first.link, second.link)

    def _margin(self, i: int, j: int) -> float:
        kinds = (self._of[i].kind, self._of[j].kind)
        if "held" in kinds:
            return CARRIED_MARGIN
        if any(self._of[k].kind == "thing" and self._of[k].owner not in self._things for k in (i, j)):
            return TABLE_MARGIN
        return WORLD_MARGIN if "thing" in kinds else ARM_MARGIN

    def _may_touch(self, i: int, j: int, gripped: str | None) -> bool:
        return any(
            thing.kind == "thing" and thing.owner == gripped and other.gripping
            for thing, other in ((self._of[i], self._of[j]), (self._of[j], self._of[i]))
        )


def _kit_solids(kit: Kit) -> list[Box | Cylinder]:
    """Return the plate and the walls of a kit, in its frame."""
    high = kit.plate + kit.wall_height / 2
    walls = (Box((x, y, high), (2 * a, 2 * b, kit.wall_height)) for (x, y), (a, b) in kit.walls())
    return [Box((0, 0, 0), (*kit.size, kit.thickness)), *walls]


def _solid(thing: Object) -> Box | Cylinder:
    """Return the solid of an object, in its frame."""
    return Cylinder(thing.size[0] / 2, thing.height) if thing.shape == "cylinder" else Box((0, 0, 0), thing.size)


@dataclasses.dataclass(frozen=True)
class SafetyClearance:
    """Picklable factory for `safety.Rules.clearance_of`: arms against each other, the body and the tables; what
    perception sees has no part in it."""

    robot: RobotModel
    task: Task

    def __call__(self) -> Callable[[Mapping[str, Joints]], float]:
        return CellClearance(self.robot, self.task, movable=False).distance
