"""How a playback looks: the gripper travels, grasps, carries and lets go, and what it lets go of really falls."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from jaxtyping import Float

from bt_jax.mjx_env.episodes.playback import Playback, Tick
from bt_jax.mjx_env.render.grasps import Grasp, grasps
from bt_jax.mjx_env.render.offscreen import GripperPose
from bt_jax.mjx_env.scene.mjcf import GRAVITY, REFERENCE_SIZE, compile_scene, gripper_unit, timing
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Released, act
from bt_jax.mjx_env.surfaces import half_extents, standing_extents
from bt_jax.mjx_env.world import World, turned_about_vertical
from bt_jax.tasks import Task

__all__ = ["Shot", "Stage", "shots"]

WIDE = 1.25  # opening of the empty gripper, in widths of the object that it is to take
FINGER = 0.07  # half the thickness of a finger, in units of the gripper
ENOUGH = 0.5  # room beside a finger that is as good as more, in units of the gripper
TURNS = (0.15, 0.85)  # parts of a way through the air between which the gripper turns, opens and closes
GRASP_SECONDS = 0.22
RISE_SECONDS = 0.4
PAUSE_SECONDS = 0.4
END_SECONDS = 1.2
TROUBLE_SECONDS = 0.6
MEDDLE_SECONDS = 0.8
DRIVE_SPEED = 1.2  # metres a second

Pose = Float[np.ndarray, "7"]
Poses = Float[np.ndarray, "B 7"]


@dataclasses.dataclass(frozen=True)
class Shot:
    """One frame: poses of all objects (metres, world; quaternion wxyz) and of the gripper, what is being done, and where a
    base is that the robot has."""

    poses: Poses
    gripper: GripperPose
    caption: str = ""
    base: Float[np.ndarray, "2"] | None = None


def shots(semantics: LeafSemantics, playback: Playback, *, fps: float) -> list[Shot]:
    """Return the frames of a playback; motions of objects run at their real pace."""
    stage = Stage(semantics, playback.start, fps=fps)
    stage.hold(PAUSE_SECONDS)
    for i, tick in enumerate(playback.ticks):
        stage.meddle(tick.before)
        stage.caption = f"tick {i + 1}: {tick.command or tick.status.name}"
        stage.run(tick, playback.ticks[i + 1 :])
        for trouble in tick.troubles:
            stage.caption = trouble
            stage.hold(TROUBLE_SECONDS)
    stage.caption = "end"
    stage.leave()
    stage.hold(END_SECONDS)
    return stage.shots


class Stage:
    """The scene as it is in the last of its `shots`; every method adds some.

    It begins in `start`, a batch of one state (NumPy), and with the gripper where it is, at home or at the object that it
    holds unless told otherwise.
    """

    def __init__(
        self, semantics: LeafSemantics, start: World, *, fps: float, gripper: GripperPose | None = None
    ) -> None:
        self.semantics, self.task, self.fps = semantics, semantics.task, fps
        self.poses = start.poses[0].astype(float)
        self.unit = gripper_unit(self.task)
        self.tall = max(self.unit, *(thing.height for thing in self.task.objects))
        self.scale = math.sqrt(self.tall / REFERENCE_SIZE)
        self.rising = RISE_SECONDS * self.scale
        self.top = max(table.top for table in self.task.tables)
        self.base = None if start.base is None else start.base[0].astype(float)
        self.tip, self.yaw = self.home, 0.0
        self.held: int | None = None
        self.opening = WIDE * self.unit if start.gripper_open[0] else 0.0
        if start.held[0] >= 0:
            self.held = int(start.held[0])
            grasp = grasps(self.task, self.task.objects[self.held], self.poses[self.held])[0]
            self.tip, self.opening, self.yaw = self._tip(self.poses[self.held], grasp.lift), grasp.width, grasp.yaw
        if gripper is not None:
            self.tip, self.opening, self.yaw = np.array(gripper.position, float), gripper.opening, gripper.yaw
        self.caption = "start"
        self.shots: list[Shot] = []
        self.shoot()

    def shoot(self) -> None:
        x, y, z = map(float, self.tip)
        gripper = GripperPose((x, y, z), float(self.opening), float(self.yaw))
        self.shots.append(Shot(self.poses.copy(), gripper, self.caption, self.base))

    def hold(self, seconds: float) -> None:
        self.shots += [self.shots[-1]] * round(seconds * self.fps)

    def run(self, tick: Tick, later: Sequence[Tick]) -> None:
        """Show the command of a tick, if it has one; `later` ticks tell where an object that is taken will be put."""
        command = tick.command
        if command is None:
            return
        if command.name == "approach":
            self.drive(tick)
            return
        released = self._released(tick)
        motion = _fall(self.task, released, tick.after.poses[0].astype(float), self.fps)
        handled = int(released.box[0])
        if tick.mishaps is not None and (tick.mishaps.jams[0] or tick.mishaps.slips[0]):
            self._fail(command.name, tick, later, slips=bool(tick.mishaps.slips[0]))
            return
        match command.name:
            case "pick":
                grasp = self._choose_grasp(handled, tick, later)
                self.travel(self._tip(tick.before.poses[0, handled], grasp.lift), grasp.yaw, WIDE * grasp.width)
                self.grip(grasp.width)
                self.held = handled
                self.move(self._line(self._tip(released.poses[0, handled], grasp.lift)), self.rising, motion=motion)
            case "place":
                lift = self.tip[2] - self.poses[handled, 2]
                turn = _turned(tick.before.poses[0, handled], released.poses[0, handled])
                self.travel(self._tip(released.poses[0, handled], lift), self.yaw + turn, self.opening)
                self.let_go(WIDE * self.opening, motion)
            case "open_gripper":
                self.let_go(WIDE * self.unit, motion)
            case "close_gripper":
                self.grip(0.0)
        self.poses = tick.after.poses[0].astype(float)

    def _fail(self, name: str, tick: Tick, later: Sequence[Tick], *, slips: bool) -> None:
        """Show a command that comes to nothing: the gripper goes where it would have done it, and, if the object `slips`,
        closes and rises without it."""
        assert tick.command is not None
        released = self._carried_out(tick)
        handled = int(released.box[0])
        if name == "pick":
            grasp = self._choose_grasp(handled, tick, later)
            self.travel(self._tip(tick.before.poses[0, handled], grasp.lift), grasp.yaw, WIDE * grasp.width)
            if slips:
                self.grip(grasp.width)
                above = self.tip + np.array([0, 0, 0.5 * self.tall])
                self.move(self._line(above), self.rising, opening=0.0)
        elif name == "place":
            lift = self.tip[2] - self.poses[handled, 2]
            turn = _turned(tick.before.poses[0, handled], released.poses[0, handled])
            self.travel(self._tip(released.poses[0, handled], lift), self.yaw + turn, self.opening)

    def meddle(self, world: World) -> None:
        """Show what has happened to objects since the last tick: they glide to where they are now."""
        before, after = self.poses, world.poses[0].astype(float)
        if np.array_equal(before.astype(np.float32), after.astype(np.float32)):
            return
        count = max(1, round(MEDDLE_SECONDS * self.fps))
        for k in range(1, count + 1):
            self.poses = _between(before, after, _ease(k / count))
            self.shoot()
        self.poses = after

    def drive(self, tick: Tick) -> None:
        """Move the base to where it is after a tick at an even pace, with the gripper, and what it holds, above it."""
        assert self.base is not None and tick.after.base is not None  # noqa: PT018
        start, goal = self.base, tick.after.base[0].astype(float)
        tip_before, before, after = self.tip, self.poses, tick.after.poses[0].astype(float)
        over = self._over(goal)
        if self.held is not None:
            over = self._tip(after[self.held], self.tip[2] - self.poses[self.held, 2])
        count = max(1, round(float(np.linalg.norm(goal - start)) / DRIVE_SPEED * self.fps))
        for k in range(1, count + 1):
            self.base = start + k / count * (goal - start)
            self.tip = tip_before + k / count * (over - tip_before)
            self.poses = _between(before, after, k / count)
            self.shoot()

    def leave(self) -> None:
        """Send an empty gripper back to where it hides nothing."""
        if self.held is None:
            self.travel(self.home, self.yaw, self.opening)

    def move(
        self,
        path: Callable[[float], np.ndarray],
        seconds: float,
        *,
        yaw: float | None = None,
        opening: float | None = None,
        motion: Sequence[Poses] = (),
        turns: tuple[float, float] = (0.0, 1.0),
    ) -> None:
        """Move the tip along `path` from 0 to 1, and turn, open and close between the parts `turns` of it; a held object
        comes along and turns with it, the others follow `motion`."""
        count = max(1, round(seconds * self.fps))
        yaw_before, opening_before, tip_before = self.yaw, self.opening, self.tip
        held = None if self.held is None else self.poses[self.held].copy()
        for k in range(1, max(count, len(motion)) + 1):
            part = _ease(min(k / count, 1.0))
            self.tip = path(part)
            turned = _ease(min(max((part - turns[0]) / (turns[1] - turns[0]), 0.0), 1.0))
            self.yaw = yaw_before if yaw is None else yaw_before + turned * (yaw - yaw_before)
            self.opening = opening_before if opening is None else opening_before + turned * (opening - opening_before)
            if len(motion):
                self.poses = motion[min(k, len(motion)) - 1].copy()
            if held is not None:
                self.poses[self.held, :3] = self.tip + held[:3] - tip_before
                self.poses[self.held, 3:] = turned_about_vertical(held[3:], np.asarray(self.yaw - yaw_before))
            self.shoot()

    def travel(self, goal: np.ndarray, yaw: float, opening: float) -> None:
        """Travel along an arch that leaves and arrives vertically and clears everything that stands on the tables. An empty
        gripper looks alike after half a turn, and turns the shorter way."""
        start, goal = self.tip, np.asarray(goal, float)
        others = np.arange(len(self.poses)) != self.held
        walls = self.top + max(kit.rim + kit.plate for kit in self.task.kits)
        tops = self.poses[:, 2] + half_extents(self.task.objects, self.poses[:, 3:].astype(np.float32))[:, 2]
        high = np.max(tops[others], initial=walls)
        distance = float(np.linalg.norm(goal[:2] - start[:2]))
        apex = max(high + 0.9 * self.tall + 0.07 * distance, goal[2], start[2])
        rise = (8 * apex - start[2] - goal[2]) / 6
        control = np.array([start[2], rise, rise, goal[2]])
        turn = yaw - self.yaw
        if self.held is None:
            turn = (turn + math.pi / 2) % math.pi - math.pi / 2

        def arch(s: float) -> np.ndarray:
            height = float(np.array([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3]) @ control)
            return np.array([*(start[:2] + _ease(s) * (goal[:2] - start[:2])), height])

        seconds = (0.5 + 0.6 * math.sqrt(distance / self.scale**2)) * self.scale
        self.move(arch, seconds, yaw=self.yaw + turn, opening=opening, turns=TURNS)

    def grip(self, opening: float) -> None:
        """Move the fingers."""
        self.move(self._line(self.tip), GRASP_SECONDS, opening=opening)

    def let_go(self, opening: float, motion: Sequence[Poses]) -> None:
        """Open the fingers, then rise; the objects fall meanwhile."""
        self.held = None
        first = round(GRASP_SECONDS * self.fps)
        self.move(self._line(self.tip), GRASP_SECONDS, opening=opening, motion=motion[:first])
        above = self.tip + np.array([0, 0, 1.3 * self.tall])
        self.move(self._line(above), self.rising, motion=motion[first:])

    def _over(self, base: Float[np.ndarray, "2"]) -> np.ndarray:
        """Return where the fingertips are above a base."""
        return np.array([*base, self.task.robot_position[2] + self.tall])

    @property
    def home(self) -> np.ndarray:
        """A point above the base or, without one, over the edge of the middle of the tables on the robot's side, where the
        gripper hides nothing."""
        if self.base is not None:
            return self._over(self.base)
        middle = np.mean([table.position[:2] for table in self.task.tables], axis=0)
        toward = np.array(self.task.robot_position[:2]) - middle
        half = min(min(table.size[:2]) for table in self.task.tables) / 2
        edge = middle + 0.8 * half * toward / max(float(np.linalg.norm(toward)), 1e-9)
        return np.array([*edge, self.top + 2.4 * self.tall])

    def _line(self, goal: np.ndarray) -> Callable[[float], np.ndarray]:
        start = self.tip
        return lambda s: start + s * (np.asarray(goal, float) - start)

    def _released(self, tick: Tick) -> Released:
        """Return the state in the middle of a command, in the way it goes."""
        return act(self.semantics, tick.before, self._number(tick), tick.mishaps)

    def _carried_out(self, tick: Tick) -> Released:
        """Return the state in the middle of a command as if nothing went wrong."""
        return act(self.semantics, tick.before, self._number(tick))

    def _number(self, tick: Tick) -> np.ndarray:
        return np.array([self.semantics.commands.index(tick.command)], np.int32)

    def _choose_grasp(self, box: int, tick: Tick, later: Sequence[Tick]) -> Grasp:
        """Return the grasp with most room for the fingers where the object is taken and where it is put, the narrowest of
        those that have enough."""
        scenes = [(tick.before.poses[0], 0.0)]
        put = next((t for t in later if t.command is not None and t.command.name != "close_gripper"), None)
        if put is not None:
            poses = self._released(put).poses[0]
            scenes.append((poses, _turned(tick.before.poses[0, box], poses[box])))
        choices = grasps(self.task, self.task.objects[box], tick.before.poses[0, box])
        return max(choices, key=lambda grasp: min(self._room(box, poses, grasp, turn) for poses, turn in scenes))

    def _room(self, box: int, poses: Poses, grasp: Grasp, turn: float) -> float:
        """Return the distance of the fingers from the objects beside, metres."""
        reach, yaw = WIDE * grasp.width / 2 + FINGER * self.unit, grasp.yaw + turn
        along = reach * np.array([math.cos(yaw), math.sin(yaw)])
        half = standing_extents(self.task, poses[:, 3:].astype(np.float32))
        beside = np.abs(poses[:, 2] - poses[box, 2]) < half[:, 2] + half[box, 2]
        beside[box] = False
        away = np.abs(poses[beside, None, :2] - (poses[box, :2] + np.array([along, -along]))) - half[beside, None, :2]
        return float(np.min(away.max(axis=-1), initial=ENOUGH * self.unit))

    def _tip(self, pose: Pose, lift: float) -> np.ndarray:
        """Return where the tips are that hold an object."""
        return np.array([*pose[:2], pose[2] + lift], float)


def _ease(part: float) -> float:
    """Return minimum-jerk progress from 0 to 1 (Flash and Hogan 1985)."""
    return part**3 * (10 - 15 * part + 6 * part**2)


def _turned(before: Pose, after: Pose) -> float:
    """Return by how much [rad] a pose was turned about the vertical, the shorter way."""
    w, x, y, z = np.asarray(before[3:], float) * (1, -1, -1, -1)
    a, b, c, d = np.asarray(after[3:], float)
    angle = 2 * math.atan2(a * z + b * y - c * x + d * w, a * w - b * x - c * y - d * z)
    return math.remainder(angle, 2 * math.pi)


def _fall(task: Task, released: Released, after: Poses, fps: float) -> list[Poses]:
    """Return the poses of all objects, frame by frame, from their release until they rest at `after`: as simulated, or,
    if that leads elsewhere because the level has no dynamics, a glide."""
    start, present = released.poses[0].astype(float), released.present[0]
    if not present.any():
        return []
    size = timing(task).size
    frames = _simulate(task, released.world.kits[0], start, present, fps)
    if not _alike(frames[-1][present], after[present], size):
        height = max(float((start[:, 2] - after[:, 2]).max()), 0.5 * size)
        frames = [start] * max(2, round(1.2 * math.sqrt(2 * height / GRAVITY) * fps))
    else:
        moving = [k for k, poses in enumerate(frames) if np.abs(poses - frames[-1]).max() > 0.004 * size]
        frames = frames[: 2 + max(moving, default=-1)]
    return [_between(poses, after, _ease((k + 1) / len(frames))) for k, poses in enumerate(frames)]


def _alike(a: Poses, b: Poses, size: float) -> bool:
    away = np.linalg.norm(a[:, :3] - b[:, :3], axis=-1)
    turned = 1 - np.abs((a[:, 3:] * b[:, 3:]).sum(axis=-1))
    return bool(np.all(away < 0.2 * size) and np.all(turned < 0.02))


def _simulate(task: Task, kits: np.ndarray, start: Poses, present: np.ndarray, fps: float) -> list[Poses]:
    """Return how C MuJoCo moves the present objects, sampled at `fps`; the others stay."""
    model, ids = compile_scene(task, tuple(np.array(task.object_names)[present].tolist()))
    data = mujoco.MjData(model)
    data.qpos[:] = start[present].ravel()
    data.mocap_pos[list(ids.kit_mocaps)] = kits
    frames: list[Poses] = []
    for step in range(1, timing(task).most_steps + 1):
        mujoco.mj_step(model, data)
        if step * model.opt.timestep * fps >= len(frames) + 1:
            frames.append(start.copy())
            frames[-1][present] = data.qpos.reshape(-1, 7)
    return frames


def _between(a: Poses, b: Poses, part: float) -> Poses:
    """Return poses on the way from a to b."""
    sign = np.where((a[:, 3:] * b[:, 3:]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    aligned = np.concatenate([b[:, :3], sign * b[:, 3:]], axis=-1)
    mixed = a + part * (aligned - a)
    mixed[:, 3:] /= np.linalg.norm(mixed[:, 3:], axis=-1, keepdims=True)
    return mixed
