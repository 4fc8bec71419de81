"""Demonstrations: what they are, and how they lie on the disk.

A demonstration is a sequence of picks and places; for each of them, the pose of the end effector in every frame of the
scene. On the disk, the published format:

    FOLDER/info.yaml            frames, default_frame, robot
    FOLDER/demo1/data_1.yaml    type: pick | place, vec_pos: {frame: [x, y, z]}, vec_quat: {frame: [x, y, z, w]}

Positions are metres in the named frame, quaternions are (x, y, z, w).
"""

from __future__ import annotations

import dataclasses
import math
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from jaxtyping import Float

from bt_jax.errors import UserError
from bt_jax.files import write_atomic
from bt_jax.task import Task

__all__ = ["END_EFFECTOR_HEIGHT", "Action", "Demonstration", "DemonstrationFolder", "Demonstrations", "Frames", "Pose"]

END_EFFECTOR_HEIGHT = 0.12  # of the end effector above the centre of what it holds, metres
HUGE = 1e6  # metres; no robot is that far, and no such number is meant
UNIT_SLACK = 0.01  # by which the length of a quaternion may differ from 1
Kind = Literal["pick", "place"]


@dataclasses.dataclass(frozen=True)
class Pose:
    """A position in metres and a unit quaternion (x, y, z, w)."""

    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)

    def apply(self, point: Sequence[float]) -> Float[np.ndarray, "3"]:
        """A point given in this pose's axes, in the frame that the pose is given in."""
        axis, w = self.quaternion[:3], self.quaternion[3]
        turn = 2 * _cross(axis, point)
        return np.array(self.position) + point + w * turn + _cross(axis, turn)


@dataclasses.dataclass(frozen=True)
class Frames:
    """The frames in which poses are recorded: the fixtures' and objects', and the robot's; `default` serves where the
    demonstrations do not say which frame is meant."""

    names: tuple[str, ...]
    default: str
    robot: str

    @staticmethod
    def of(task: Task) -> Frames:
        """Those of a task: the kit's, the boxes' and the robot's, which is the default."""
        return Frames((task.kit.name, *task.box_names, task.robot_frame), task.robot_frame, task.robot_frame)

    @property
    def objects(self) -> tuple[str, ...]:
        """All frames but the robot's."""
        return tuple(name for name in self.names if name != self.robot)


@dataclasses.dataclass(frozen=True)
class Action:
    """A pick or a place, with the pose of the end effector in every frame at that moment."""

    kind: Kind
    poses: Mapping[str, Pose]

    def handled(self, frame: str) -> Float[np.ndarray, "3"]:
        """Where the centre of the handled object is, in a frame [m]: below the end effector."""
        return self.poses[frame].apply((0.0, 0.0, -END_EFFECTOR_HEIGHT))

    def nearest(self, frames: Sequence[str]) -> str:
        """Which of the frames the handled object is nearest to."""
        return min(frames, key=lambda frame: float(np.linalg.norm(self.handled(frame))))


@dataclasses.dataclass(frozen=True)
class Demonstration:
    """What one person did once, from the first action to the last."""

    name: str
    actions: tuple[Action, ...]


@dataclasses.dataclass(frozen=True)
class Demonstrations:
    """A set of demonstrations of one task. `problems` says, a sentence each, which ones were left out and why."""

    frames: Frames
    demonstrations: tuple[Demonstration, ...]
    problems: tuple[str, ...] = ()

    def __iter__(self) -> Iterator[Demonstration]:
        return iter(self.demonstrations)

    def __len__(self) -> int:
        return len(self.demonstrations)


class _Unusable(Exception):
    """Why a demonstration cannot be used."""


@dataclasses.dataclass(frozen=True)
class DemonstrationFolder:
    """A folder in the published format; nothing in it is overwritten."""

    path: Path

    def create(self, frames: Frames) -> None:
        """Writes `info.yaml`, or checks that the one there says the same."""
        if (self.path / "info.yaml").exists():
            if self.frames() != frames:
                raise UserError(f"{self.path} holds demonstrations with other frames; choose another folder")
            return
        info = {"default_frame": frames.default, "frames": list(frames.names), "robot": frames.robot}
        write_atomic(self.path / "info.yaml", yaml.safe_dump(info))

    def frames(self) -> Frames:
        """Reads `info.yaml`. Raises UserError where it is missing or incomplete."""
        source = self.path / "info.yaml"
        if not self.path.is_dir():
            raise UserError(f"there is no folder {self.path}; give one with demonstrations, or record some into it")
        if not source.is_file():
            raise UserError(f"{source} is missing; restore it, or record the demonstrations into a new folder")
        try:
            data = _mapping(source)
            names, default, robot = data.get("frames"), data.get("default_frame"), data.get("robot")
            if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
                raise _Unusable(f"{source}: frames must be a list of names; mend it")
            if len(set(names)) < len(names) or len(names) < 2:
                raise _Unusable(f"{source}: frames must name at least two frames, each once; mend it")
            for key, name in (("default_frame", default), ("robot", robot)):
                if name not in names:
                    raise _Unusable(f"{source}: {key} '{name}' is not one of the frames; use one of {', '.join(names)}")
        except _Unusable as problem:
            raise UserError(str(problem)) from None
        return Frames(tuple(names), default, robot)

    def names(self) -> list[str]:
        """The demonstrations, in natural order: demo2 before demo10."""
        folders = [path.name for path in self.path.iterdir() if path.is_dir() and not path.name.startswith(".")]
        return sorted(folders, key=lambda name: [(part.isdigit(), int(part) if part.isdigit() else 0, part)
                                                 for part in re.split(r"(\d+)", name)])  # fmt: skip

    def read(self) -> Demonstrations:
        """All demonstrations that can be used, and for each of the others a sentence. Raises UserError where none can."""
        frames = self.frames()
        good, problems = [], []
        for name in self.names():
            try:
                good.append(self._demonstration(name, frames))
            except _Unusable as problem:
                problems.append(str(problem))
        if not good:
            raise UserError(" ".join(problems) if problems else f"{self.path} holds no demonstration; record some")
        return Demonstrations(frames, tuple(good), tuple(problems))

    def append(self, demonstration: Demonstration) -> Demonstration:
        """Adds a demonstration under the next free name demoN, whole or not at all, and returns it under that name."""
        frames = self.frames()
        numbers = [int(name[4:]) for name in self.names() if re.fullmatch(r"demo\d+", name)]
        named = dataclasses.replace(demonstration, name=f"demo{max(numbers, default=0) + 1}")
        if (problem := _problem(named, frames, where=named.name)) is not None:
            raise UserError(problem)
        part = self.path / f".{named.name}.part"
        shutil.rmtree(part, ignore_errors=True)
        for i, action in enumerate(named.actions, start=1):
            data = {
                "type": action.kind,
                "vec_pos": {frame: _numbers(pose.position) for frame, pose in action.poses.items()},
                "vec_quat": {frame: _numbers(pose.quaternion) for frame, pose in action.poses.items()},
            }
            write_atomic(part / f"data_{i}.yaml", yaml.safe_dump(data, default_flow_style=None))
        part.rename(self.path / named.name)
        return named

    def delete(self, name: str) -> None:
        """Removes one demonstration. Raises UserError where there is none of that name."""
        shutil.rmtree(self._existing(name))

    def rename(self, name: str, new: str) -> None:
        """Gives a demonstration another name. Raises UserError where that is taken or no name."""
        if not re.fullmatch(r"\w[\w -]*", new):
            raise UserError(f"'{new}' cannot name a demonstration; use letters, digits, spaces, - and _")
        if (self.path / new).exists():
            raise UserError(f"{self.path / new} exists already; choose another name")
        self._existing(name).rename(self.path / new)

    def _existing(self, name: str) -> Path:
        self.frames()
        if name not in self.names():
            raise UserError(f"{self.path} has no demonstration '{name}'; it has {', '.join(self.names()) or 'none'}")
        return self.path / name

    def _demonstration(self, name: str, frames: Frames) -> Demonstration:
        folder = self.path / name
        files = sorted(folder.glob("data_*.yaml"), key=lambda path: int("0" + "".join(re.findall(r"\d+", path.stem))))
        if not files:
            raise _Unusable(f"{folder} is left out: it holds no data_1.yaml; record it again or delete it.")
        for i, file in enumerate(files, start=1):
            if file.name != f"data_{i}.yaml":
                raise _Unusable(f"{folder} is left out: data_{i}.yaml is missing; restore it or delete the folder.")
        demonstration = Demonstration(name, tuple(_action(file, frames) for file in files))
        if (problem := _problem(demonstration, frames, where=str(folder))) is not None:
            raise _Unusable(f"{folder} is left out: {problem}.")
        return demonstration


def _problem(demonstration: Demonstration, frames: Frames, *, where: str) -> str | None:
    """Why the actions make no whole demonstration, or None."""
    held = False
    for i, action in enumerate(demonstration.actions, start=1):
        if set(action.poses) != set(frames.names):
            return f"{where}, action {i}: there must be one pose for each of {', '.join(frames.names)}; record it again"
        for frame, pose in action.poses.items():
            if not _is_unit(pose.quaternion) or not all(map(math.isfinite, pose.position)):
                return f"{where}, action {i}: the pose in {frame} is not finite or no rotation; record it again"
        if (action.kind == "place") != held:
            before = "a place follows no pick" if action.kind == "place" else "a pick follows a pick without a place"
            return f"action {i}: {before}; record it again"
        held = not held
    if held:
        return "it ends with an object in the gripper; place it and record again"
    return None if demonstration.actions else "it has no actions; record it again"


def _action(file: Path, frames: Frames) -> Action:
    data = _mapping(file)
    kind = data.get("type")
    if kind not in ("pick", "place"):
        raise _Unusable(f"{file}: type is {kind!r}; write pick or place, or delete the demonstration.")
    positions = _vectors(data, "vec_pos", 3, file, frames)
    quaternions = _vectors(data, "vec_quat", 4, file, frames)
    for frame, quaternion in quaternions.items():
        if not _is_unit(quaternion):
            length = math.hypot(*quaternion)
            raise _Unusable(f"{file}: the quaternion in {frame} has length {length:.3f}, not 1; record it again.")
    return Action(kind, {frame: Pose(positions[frame], quaternions[frame]) for frame in frames.names})


def _is_unit(quaternion: Sequence[float]) -> bool:
    return abs(math.hypot(*quaternion) - 1) <= UNIT_SLACK


def _vectors(data: Mapping[str, Any], key: str, count: int, file: Path, frames: Frames) -> dict[str, tuple[float, ...]]:
    """One vector for each frame."""
    values = data.get(key)
    if not isinstance(values, Mapping):
        raise _Unusable(f"{file}: {key} is missing; record the demonstration again or delete it.")
    for frame in values:
        if frame not in frames.names:
            raise _Unusable(f"{file}: {key} names the frame '{frame}', which info.yaml does not; add it there.")
    for frame in frames.names:
        if frame not in values:
            raise _Unusable(f"{file}: {key} lacks the frame {frame}; record the demonstration again or delete it.")
    return {frame: _vector(values[frame], count, file, f"{key}.{frame}") for frame in frames.names}


def _vector(value: Any, count: int, file: Path, where: str) -> tuple[float, ...]:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(x) in (int, float) and abs(x) < HUGE for x in value):
        raise _Unusable(f"{file}: {where} is {value!r}, not {count} finite numbers; record it again or delete it.")
    return tuple(map(float, value))


def _mapping(file: Path) -> Mapping[str, Any]:
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise _Unusable(f"{file} cannot be read ({type(error).__name__}); restore or delete it.") from error
    if not isinstance(data, Mapping):
        raise _Unusable(f"{file} is empty or half written; restore or delete it.")
    return data


def _cross(a: Iterable[float], b: Iterable[float]) -> Float[np.ndarray, "3"]:
    """What np.cross does, in a tenth of its time."""
    (x, y, z), (u, v, w) = a, b
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _numbers(values: Sequence[float]) -> list[float]:
    """To 0.01 mm, which no demonstrator can place."""
    return [round(float(value), 5) + 0.0 for value in values]
