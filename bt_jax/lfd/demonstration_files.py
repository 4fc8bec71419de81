"""One demonstration in the published format, a file for each action:

    demo1/data_1.yaml    type: pick | place, vec_pos: {frame: [x, y, z]}, vec_quat: {frame: [x, y, z, w]}

Quaternions are xyzw in the files and wxyz everywhere else.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.yaml_files import read_yaml, to_yaml
from bt_jax.lfd.demonstration import Action, Demonstration, Frames, Pose

__all__ = ["HUGE", "Unusable", "problem_of", "read_demonstration", "read_mapping", "write_demonstration"]

HUGE = 1e6  # metres; a larger number is a mistake
UNIT_SLACK = 0.01  # by which the length of a quaternion may differ from 1


class Unusable(Exception):
    """Why a demonstration cannot be used."""


def read_demonstration(folder: Path, frames: Frames) -> Demonstration:
    """Read a folder of data_1.yaml, data_2.yaml, ... Raise Unusable, with a sentence, if it is incomplete or invalid."""
    files = sorted(folder.glob("data_*.yaml"), key=lambda path: int("0" + "".join(re.findall(r"\d+", path.stem))))
    if not files:
        raise Unusable(f"{folder} is left out: it holds no data_1.yaml; record it again or delete it.")
    for i, file in enumerate(files, start=1):
        if file.name != f"data_{i}.yaml":
            raise Unusable(f"{folder} is left out: data_{i}.yaml is missing; restore it or delete the folder.")
    demonstration = Demonstration(folder.name, tuple(_action(file, frames) for file in files))
    if (problem := problem_of(demonstration, frames, where=str(folder))) is not None:
        raise Unusable(f"{folder} is left out: {problem}.")
    return demonstration


def write_demonstration(folder: Path, demonstration: Demonstration) -> None:
    """Write one file for each action into a folder."""
    for i, action in enumerate(demonstration.actions, start=1):
        data = {
            "type": action.kind,
            "vec_pos": {frame: _numbers(pose.position) for frame, pose in action.poses.items()},
            "vec_quat": {frame: _numbers(_xyzw(pose.quaternion)) for frame, pose in action.poses.items()},
        }
        write_atomic(folder / f"data_{i}.yaml", to_yaml(data))


def problem_of(demonstration: Demonstration, frames: Frames, *, where: str) -> str | None:
    """Return why the actions make no whole demonstration, or None."""
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
    data = read_mapping(file)
    kind = data.get("type")
    if kind not in ("pick", "place"):
        raise Unusable(f"{file}: type is {kind!r}; write pick or place, or delete the demonstration.")
    positions = _vectors(data, "vec_pos", 3, file, frames)
    quaternions = _vectors(data, "vec_quat", 4, file, frames)
    for frame, quaternion in quaternions.items():
        if not _is_unit(quaternion):
            length = math.hypot(*quaternion)
            raise Unusable(f"{file}: the quaternion in {frame} has length {length:.3f}, not 1; record it again.")
    return Action(kind, {frame: _pose(positions[frame], quaternions[frame]) for frame in frames.names})


def _pose(position: Sequence[float], xyzw: Sequence[float]) -> Pose:
    """Return a pose from the numbers of the format."""
    (a, b, c), (x, y, z, w) = position, xyzw
    return Pose((a, b, c), (w, x, y, z))


def _xyzw(quaternion: Sequence[float]) -> tuple[float, ...]:
    """Return a quaternion wxyz in the order of the format."""
    w, x, y, z = quaternion
    return x, y, z, w


def _is_unit(quaternion: Sequence[float]) -> bool:
    return abs(math.hypot(*quaternion) - 1) <= UNIT_SLACK


def _vectors(data: Mapping[str, Any], key: str, count: int, file: Path, frames: Frames) -> dict[str, tuple[float, ...]]:
    """Return one vector for each frame."""
    values = data.get(key)
    if not isinstance(values, Mapping):
        raise Unusable(f"{file}: {key} is missing; record the demonstration again or delete it.")
    for frame in values:
        if frame not in frames.names:
            raise Unusable(f"{file}: {key} names the frame '{frame}', which info.yaml does not; add it there.")
    for frame in frames.names:
        if frame not in values:
            raise Unusable(f"{file}: {key} lacks the frame {frame}; record the demonstration again or delete it.")
    return {frame: _vector(values[frame], count, file, f"{key}.{frame}") for frame in frames.names}


def _vector(value: Any, count: int, file: Path, where: str) -> tuple[float, ...]:
    good = isinstance(value, list) and len(value) == count
    if not good or not all(type(x) in (int, float) and abs(x) < HUGE for x in value):
        raise Unusable(f"{file}: {where} is {value!r}, not {count} finite numbers; record it again or delete it.")
    return tuple(map(float, value))


def read_mapping(file: Path) -> Mapping[str, Any]:
    try:
        data = read_yaml(file)
    except UserError as error:
        raise Unusable(f"{error}, or delete it.") from error
    if not isinstance(data, Mapping):
        raise Unusable(f"{file} is empty or half written; restore or delete it.")
    return data


def _numbers(values: Sequence[float]) -> list[float]:
    """Round to 0.01 mm, finer than anybody can place."""
    return [round(float(value), 5) + 0.0 for value in values]
