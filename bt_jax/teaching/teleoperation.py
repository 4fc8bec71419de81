"""A person at the gripper: pick an object, carry it where it should be, let go. What they do is recorded."""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial.transform import Rotation

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Vocabulary
from bt_jax.behaviors.geometry import heading, turn_error
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT, Action, Demonstration, Frames, Pose
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.predicates import graspable, is_clear, off_floor
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act, settled_world
from bt_jax.mjx_env.surfaces import (
    fixed_surfaces,
    object_surfaces,
    outline_of,
    overlaps,
    standing_extents,
    surface_names,
)
from bt_jax.mjx_env.world import World, frames, to_world
from bt_jax.tasks import Task
from bt_jax.tasks.slots import fits, slot_position, slot_turn, slots_by_name

__all__ = ["Landing", "Teleoperation"]

SUNK = 0.1  # part of its size by which an object may be inside another where it is let go; it is set down on that one

Vector = Sequence[float] | Float[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True)
class _Snapshot:
    """The scene between two inputs of the person, and what was recorded so far."""

    world: World
    carried: Float[np.ndarray, "7"] | None  # pose of the carried object in the world: position [m], quaternion wxyz
    actions: tuple[Action, ...]
    turned: float = 0.0  # by how much the person has turned it since the pick, degrees


@dataclasses.dataclass(frozen=True)
class Landing:
    """What is below a carried object: where its centre would come to rest (world, metres) and `on` what, None for the floor;
    `inside` is the object that it would be let go in, if any."""

    position: Float[np.ndarray, "3"]
    on: str | None
    inside: str | None


class Teleoperation:
    """A demonstration in the making, from a state at rest (a batch of one, NumPy; see `mjx_env.layouts.sample_layouts`).

    Every input changes `world`; `undo` takes the last one back. Positions are metres. An input that raises UserError has
    changed nothing.
    """

    def __init__(self, task: Task, physics: Physics, start: World) -> None:
        self.task, self._settler = task, Settler(task, physics)
        self._semantics = LeafSemantics(task, Vocabulary.of([Behavior("open_gripper")]))
        self._past: list[_Snapshot] = []
        self._now = _Snapshot(start, None, ())

    @property
    def world(self) -> World:
        """The scene, a batch of one state; a carried object is where the person holds it."""
        if self._now.carried is None:
            return self._now.world
        poses = self._now.world.poses.copy()
        poses[0, int(self._now.world.held[0])] = self._now.carried
        return dataclasses.replace(self._now.world, poses=poses)

    @property
    def held(self) -> str | None:
        """The object in the gripper."""
        held = int(self._now.world.held[0])
        return None if held < 0 else self.task.object_names[held]

    @property
    def actions(self) -> tuple[Action, ...]:
        """What was recorded so far."""
        return self._now.actions

    def position(self, frame: str) -> Float[np.ndarray, "3"]:
        """Return where the carried object's centre is, in a frame. Raise UserError if nothing is held."""
        return self._in_frame(self._carried()[:3], frame)

    def turn(self, frame: str) -> float:
        """Return how far the carried object is turned about the vertical in a frame, degrees in (-180, 180]. Raise
        UserError if nothing is held."""
        pose = Pose.of(self._carried().tolist())
        return math.degrees(heading(self._pose(frame).inverse().compose(pose)))

    def pick(self, name: str) -> None:
        """Take an object and lift it; of a part, the instance nearest to the robot that can be taken and was not moved
        before. Raise UserError if that is not possible."""
        if name not in self.task.instances:
            raise UserError(f"there is no object '{name}' to pick; use one of {', '.join(self.task.instances)}")
        if self.held is not None:
            raise UserError(f"the gripper holds {self.held}; release it before you pick {name}")
        world = self._now.world
        index = self.task.object_names.index(self._taken(name))
        pick = Behavior("pick", (self.task.object_names[index],))
        grasp = np.asarray(world.poses[0, index, :3], float)
        action = Action("pick", self._end_effector(world, grasp))
        after, _ = self._done(LeafSemantics(self.task, Vocabulary.of([pick])), world, pick)
        self._push(_Snapshot(after, np.asarray(after.poses[0, index], float), (*self.actions, action)))

    def _taken(self, name: str) -> str:
        """Return which object a pick takes. Raise UserError if there is none that can be taken."""
        task, world, names = self.task, self._now.world, self.task.object_names
        moved = set(Demonstration("", self.actions).things(Frames.of(task))) if self.actions else set()
        own = [one for one in task.instances[name] if name in names or one not in moved]
        left = own
        for able, why in (
            (off_floor, "it lies out of reach"),
            (is_clear, "something stands on it"),
            (graspable, "it leaves the gripper no room"),
        ):
            can = able(world, task)[0]
            known, left = left, [one for one in left if can[names.index(one)]]
            if known and not left:
                raise UserError(f"{name} cannot be picked, {why}; pick another object first")
        if not left:
            raise UserError(f"every {name} was moved before; pick another object")
        x, y, _ = task.robot_position
        return min(left, key=lambda one: math.dist(world.poses[0, names.index(one), :2].tolist(), (x, y)))

    def move(self, by: Vector) -> None:
        """Carry the held object by a vector in the world's axes; not below the floor. Raise UserError out of reach."""
        self.move_to(
            self._in_frame(self._carried()[:3] + np.asarray(by, float), self.task.robot_frame), self.task.robot_frame
        )

    def turn_by(self, degrees: float) -> None:
        """Turn the held object about the vertical, counter-clockwise seen from above."""
        carried = self._carried()
        if not math.isfinite(degrees):
            raise UserError("the turn is not finite; give degrees, as 90")
        turn = Pose(
            (0.0, 0.0, 0.0), (math.cos(math.radians(degrees) / 2), 0.0, 0.0, math.sin(math.radians(degrees) / 2))
        )
        turned = np.array([*carried[:3], *turn.compose(Pose.of(carried.tolist())).quaternion])
        self._push(dataclasses.replace(self._now, carried=turned, turned=self._now.turned + degrees))

    def turn_to(self, degrees: float, frame: str) -> None:
        """Turn the held object, the shorter way, until it lies turned by so many degrees in a frame, or looks like that."""
        carried, thing = Pose.of(self._carried().tolist()), self.task.thing(str(self.held))
        self.turn_by(-math.degrees(turn_error(thing, carried, self._pose(frame), degrees)))

    def move_to(self, position: Vector, frame: str) -> None:
        """Carry the held object's centre to a position in a frame. Raise UserError out of reach."""
        carried = self._carried()
        if frame not in self.task.frames or frame == self.held:
            others = ", ".join(name for name in self.task.frames if name != self.held)
            raise UserError(f"there is no frame '{frame}' to carry {self.held} to; use one of {others}")
        if not np.all(np.isfinite(position)):
            raise UserError("the position is not finite; give three numbers in metres")
        index = np.array([self.task.frames.index(frame)])
        in_world = to_world(frames(self._now.world, self.task), index, np.asarray([position], np.float32))
        goal = np.asarray(in_world[0, 0], float)
        goal[2] = max(goal[2], self.task.floor + self.task.thing(str(self.held)).height / 2)
        low, high = self._reach
        if not np.all((goal >= low) & (goal <= high)):
            raise UserError(f"the gripper does not reach that far; carry {self.held} nearer to the tables")
        self._push(dataclasses.replace(self._now, carried=np.array([*goal, *carried[3:]])))

    def move_to_slot(self, name: str, *, off: Vector = (0.0, 0.0, 0.0)) -> None:
        """Carry the held object to a slot, such as "TrayA.a1", missing it by a vector [m], and turn it as the slot says.
        Raise UserError if there is no such slot, or if it is for something else."""
        self._carried()
        slots = slots_by_name(self.task.kits)
        if name not in slots:
            raise UserError(f"there is no slot '{name}'; use one of {', '.join(slots) or 'a kit with slots'}")
        (kit, slot), thing = slots[name], self.task.thing(str(self.held))
        if not fits(kit, slot, thing):
            raise UserError(f"{thing.name} does not go into the slot {name}; carry it elsewhere")
        with self.together():
            self.move_to(np.add(slot_position(kit, slot, thing), off), kit.name)
            if (turn := slot_turn(kit, slot, thing)) is not None:
                self.turn_to(turn, kit.name)

    def landing(self) -> Landing:
        """Return what is below the held object. Raise UserError if nothing is held."""
        centre, world, task = self._carried()[:3], self.world, self.task
        held = int(world.held[0])
        half = standing_extents(task, world.poses[..., 3:])[0, held]
        fixed, boxes = fixed_surfaces(task, world.kits), object_surfaces(task, world.poses)
        names = [None, *surface_names(task)[1:], *task.object_names]
        tops = np.concatenate([fixed.top[0], boxes.top[0]])
        xy, reach, rise = centre[None, :2].astype(np.float32), half[None, :2], half[2]
        outline = outline_of(task, world.poses[:, held, 3:], np.array([held]))
        under = np.concatenate([overlaps(below, xy, reach, outline)[0] for below in (fixed, boxes)])
        under[len(names) - len(task.objects) + held] = False
        foot = np.concatenate([np.full(fixed.top.shape[1], -np.inf), 2 * world.poses[0, :, 2] - boxes.top[0]])
        sunk = under & (tops > centre[2] - rise + 2 * rise * SUNK) & (foot < centre[2] + rise - 2 * rise * SUNK)
        best = int(np.argmax(np.where(under, tops, -np.inf)))
        inside = names[int(np.argmax(np.where(sunk, tops, -np.inf)))] if sunk.any() else None
        return Landing(np.array([*centre[:2], float(tops[best] + rise)]), names[best], inside)

    def release(self, *, lowered: bool = False) -> None:
        """Lower the held object to its goal, or until it touches something, and let go. The goal is where it is now, or, if
        `lowered`, on what is below. Raise UserError if it is inside another object, or if something would fall to the
        floor."""
        position, landing, name = self._carried()[:3], self.landing(), str(self.held)
        if landing.inside is not None:
            raise UserError(f"{name} would be inside {landing.inside}; raise it or carry it aside, then release it")
        if landing.on is None:
            raise UserError(self._lost(name))
        position = landing.position if lowered else position
        x, y, z = self._in_frame(position, self.task.robot_frame).tolist()
        action = Behavior("place", (name, (x, y, z), self.task.robot_frame))
        held = int(self._now.world.held[0])
        turned = self._now.world.poses.copy()
        turned[0, held, 3:] = self._now.carried[3:] if self._now.carried is not None else turned[0, held, 3:]
        before = dataclasses.replace(self._now.world, poses=turned)
        after, released = self._done(LeafSemantics(self.task, Vocabulary.of([action])), before, action)
        known, now = (off_floor(world, self.task)[0] for world in (before, after))
        if np.any(known & ~now):
            raise UserError(self._lost(self.task.object_names[int(np.argmax(known & ~now))]))
        let_go = self._end_effector(before, released[held, :3].astype(float), moved=held, turned=self._now.turned)
        self._push(_Snapshot(after, None, (*self.actions, Action("place", let_go))))

    @contextlib.contextmanager
    def together(self) -> Iterator[None]:
        """Take the inputs that follow as one, which is undone at once. If one of them raises an error, none of them has
        changed anything."""
        past, now = [*self._past], self._now
        try:
            yield
        except BaseException:
            self._past, self._now = past, now
            raise
        if self._now is not now:
            self._past = [*past, now]

    def undo(self, *, moves_together: bool = False) -> bool:
        """Take the last input back, or all moves since the pick at once; return False if there is none."""
        if not self._past:
            return False
        world, self._now = self._now.world, self._past.pop()
        while moves_together and self._now.world is world and self._past and self._past[-1].world is world:
            self._now = self._past.pop()
        return True

    def demonstration(self, name: str = "demo") -> Demonstration:
        """Return what was recorded. Raise UserError if an object is still held or nothing was done."""
        if self.held is not None:
            raise UserError(f"the gripper still holds {self.held}; release it, then finish")
        if not self.actions:
            raise UserError("nothing was demonstrated yet; pick an object and place it")
        return Demonstration(name, self.actions)

    def _lost(self, name: str) -> str:
        return f"{name} would fall to the floor, out of the gripper's reach; carry {self.held} over a table, then release it"

    @functools.cached_property
    def _reach(self) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        """Lowest and highest coordinates [m]: the tables and the robot, and around them once the width of a table."""
        task = self.task
        width = max(max(table.size[:2]) for table in task.tables)
        middles, sizes = (np.array([getattr(t, key)[:2] for t in task.tables]) for key in ("position", "size"))
        corners = np.concatenate([middles - sizes / 2, middles + sizes / 2, [task.robot_position[:2]]])
        highest = max(table.top for table in task.tables) + 2 * width
        return np.array([*corners.min(0) - width, task.floor]), np.array([*corners.max(0) + width, highest])

    def _push(self, snapshot: _Snapshot) -> None:
        self._past.append(self._now)
        self._now = snapshot

    def _carried(self) -> Float[np.ndarray, "7"]:
        if self._now.carried is None:
            raise UserError("the gripper holds nothing; pick an object first")
        return self._now.carried

    def _done(
        self, semantics: LeafSemantics, world: World, action: Behavior
    ) -> tuple[World, Float32[np.ndarray, "B 7"]]:
        """Return the state at rest after an action, and where the boxes were when the gripper had moved."""
        command = np.array([semantics.commands.index(action)], np.int32)
        released = act(semantics, world, command)
        poses, ok = self._settler.settle(released)
        if not ok[0]:
            raise UserError("the simulation diverged; undo and place it elsewhere")
        return settled_world(self.task, released, poses), np.asarray(released.poses[0])

    def _pose(self, frame: str) -> Pose:
        """Return the pose of a frame in the world; that of the held object is where it was lifted."""
        return Pose.of(frames(self._now.world, self.task)[0, self.task.frames.index(frame)].tolist())

    def _in_frame(self, point: Float[np.ndarray, "3"], frame: str) -> Float[np.ndarray, "3"]:
        pose = frames(self._now.world, self.task)[0, self.task.frames.index(frame)]
        return _into(np.asarray(pose, float), point)

    def _end_effector(
        self, world: World, centre: Float[np.ndarray, "3"], moved: int | None = None, turned: float = 0.0
    ) -> dict[str, Pose]:
        """Return the pose of the end effector, upright over an object's centre (world) and turned by some degrees, in every
        frame; the frame of the object `moved` is at that centre."""
        if moved is not None:
            poses = world.poses.copy()
            poses[0, moved, :3] = centre
            world = dataclasses.replace(world, poses=poses)
        tip = centre + np.array([0, 0, END_EFFECTOR_HEIGHT])
        found = {}
        for name, pose in zip(self.task.frames, frames(world, self.task)[0].astype(float), strict=True):
            turn = Rotation.from_quat(pose[3:], scalar_first=True).inv()  # of the end effector, in the frame
            if turned:
                turn = turn * Rotation.from_euler("z", turned, degrees=True)
            w, a, b, c = (turn.as_quat(canonical=True, scalar_first=True) + 0.0).tolist()
            x, y, z = _into(pose, tip).tolist()
            found[name] = Pose((x, y, z), (w, a, b, c))
        return found


def _into(pose: Float[np.ndarray, "7"], point: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Return a point of the world in the frame that has this pose (position, quaternion wxyz)."""
    return Rotation.from_quat(pose[3:], scalar_first=True).inv().apply(point - pose[:3])
