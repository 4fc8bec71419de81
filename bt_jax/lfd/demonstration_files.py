"""One demonstration in the published format, a file for each action:

    demo1/data_1.yaml    type: pick | place, vec_pos: {frame: [x, y, z]}, vec_quat: {frame: [x, y, z, w]}

Quaternions are xyzw in the files and wxyz everywhere else. Where poses were measured, `sigma: {frame: s}` says the standard
deviation of each position [m]; it is not part of the published format, whose readers do not look for it.
"""

from __future__ import annotations

import dataclasses
import math
import re
import types
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.yaml_files import read_yaml, to_yaml
from bt_jax.lfd.demonstration import END_EFFECTOR_HEIGHT, Action, Demonstration, Frames, Kind, Pose
from bt_jax.tasks.bounds import POSITION

__all__ = ["StrayFile", "problem_of", "read_demonstration", "recorded_frames", "write_demonstration"]

FAR = 0.5  # metres; a pick this far from every object picks none
EXAMPLES: Mapping[str, str] = types.MappingProxyType(
    {
        "type": "pick",
        "vec_pos": "{base_link: [0.3, 0.1, 0.2]}",
        "vec_quat": "{base_link: [0, 0, 0, 1]}",
    }
)
UNIT_SLACK = 0.01  # by which the length of a quaternion may differ from 1


class StrayFile(UserError):
    """A file lies among those of a demonstration and is none of its actions."""


@dataclasses.dataclass(frozen=True)
class _Record:
    """What a file holds: positions [m] and quaternions xyzw of the end effector for each frame, and how sure they are."""

    type: Kind
    vec_pos: Mapping[str, tuple[float, float, float]]
    vec_quat: Mapping[str, tuple[float, float, float, float]]
    sigma: Mapping[str, float] = dataclasses.field(default_factory=dict)


def read_demonstration(folder: Path, frames: Frames) -> Demonstration:
    """Read a folder of data_1.yaml, data_2.yaml, ... Raise UserError if it is incomplete or invalid."""
    actions = [_action(read_yaml(file), file, frames) for file in _files(folder)]
    demonstration = Demonstration(folder.name, tuple(actions))
    problem = problem_of(demonstration, frames) or _implausible(demonstration, frames)
    if problem is not None:
        raise UserError(problem)
    return demonstration


def recorded_frames(folder: Path) -> tuple[str, ...]:
    """Return the frames of the first action in the folder of a demonstration. Raise UserError if it cannot be read."""
    file = next(iter(_files(folder)))
    return tuple(decode(read_yaml(file), _Record, file).vec_pos)


def write_demonstration(folder: Path, demonstration: Demonstration) -> None:
    """Write one file for each action into a folder."""
    for i, action in enumerate(demonstration.actions, start=1):
        data: dict[str, Any] = {
            "type": action.kind,
            "vec_pos": {frame: _numbers(pose.position) for frame, pose in action.poses.items()},
            "vec_quat": {frame: _numbers(_xyzw(pose.quaternion)) for frame, pose in action.poses.items()},
        }
        if action.sigmas:
            data["sigma"] = dict(zip(action.sigmas, _numbers(list(action.sigmas.values())), strict=True))
        write_atomic(folder / f"data_{i}.yaml", to_yaml(data))


def problem_of(demonstration: Demonstration, frames: Frames) -> str | None:
    """Return why the actions are not a whole demonstration, and what to do; None if they are."""
    held = False
    for i, action in enumerate(demonstration.actions, start=1):
        if set(action.poses) != set(frames.names):
            return f"action {i}: there must be one pose for each of {', '.join(frames.names)}; record it again"
        for frame, pose in action.poses.items():
            if not _is_unit(pose.quaternion) or not all(map(math.isfinite, pose.position)):
                return f"action {i}: the pose in {frame} is not finite or no rotation; record it again"
        if (action.kind == "place") != held:
            before = "a place follows no pick" if action.kind == "place" else "a pick follows a pick without a place"
            return f"action {i}: {before}; record it again"
        held = not held
    if held:
        return "it ends with an object in the gripper; place it and record again"
    return None if demonstration.actions else "it has no actions; record it again"


def _implausible(demonstration: Demonstration, frames: Frames) -> str | None:
    """Return which numbers are in another unit or belong to another scene, None if none do."""
    nearest = _nearest_pick(demonstration, frames)
    if nearest > FAR:
        unit = " (metres? these look like millimetres)" if _nearest_pick(demonstration, frames, 0.001) < FAR else ""
        return f"at every pick the gripper was {nearest:.3g} m or more from every object; correct the positions{unit}"
    for i, action in enumerate(demonstration.actions, start=1):
        for frame, pose in action.poses.items():
            for value in pose.position:
                if (complaint := POSITION.complaint(value)) is not None:
                    return f"data_{i}.yaml, key vec_pos.{frame}: {complaint}"
    return None


def _nearest_pick(demonstration: Demonstration, frames: Frames, scale: float = 1.0) -> float:
    """Return how near what the gripper held came to any object when it picked [m], with all positions scaled."""
    poses = [
        action.poses[frame] for action in demonstration.actions if action.kind == "pick" for frame in frames.objects
    ]
    below = (0.0, 0.0, -END_EFFECTOR_HEIGHT)
    return min(float(np.linalg.norm(np.array(p.apply(below)) + (scale - 1) * np.array(p.position))) for p in poses)


def _files(folder: Path) -> list[Path]:
    """Return the files of a demonstration, one for each action. Raise UserError if one is missing or misnamed."""
    numbered = {}
    for file in sorted(folder.glob("data_*.y*ml")):
        found = re.fullmatch(r"data_([1-9]\d{0,5})", file.stem)
        if found is not None and file.suffix != ".yaml" and not file.with_suffix(".yaml").exists():
            raise StrayFile(f"{file} is called .yml; rename it to {file.stem}.yaml")
        if found is None or file.suffix != ".yaml":
            raise StrayFile(
                f"{file} is not one of its actions, which are called data_1.yaml, data_2.yaml, ...; move it out "
                "of the folder"
            )
        numbered[int(found[1])] = file
    for i in range(1, max(numbered, default=1) + 1):
        if i not in numbered:
            raise UserError(f"{folder / f'data_{i}.yaml'} is missing; restore it")
    return [numbered[i] for i in sorted(numbered)]


def _action(data: Any, file: Path, frames: Frames) -> Action:
    record = decode(data, _Record, file, examples=EXAMPLES)
    for key, vectors in (("vec_pos", record.vec_pos), ("vec_quat", record.vec_quat)):
        for frame in vectors:
            if frame not in frames.names:
                raise UserError(f"{file}, key {key}.{frame}: info.yaml has no frame of this name; add it there")
        for frame in frames.names:
            if frame not in vectors:
                raise UserError(f"{file}, key {key}.{frame}: missing; record the demonstration again")
    for frame, quaternion in record.vec_quat.items():
        if not _is_unit(quaternion):
            length = math.hypot(*quaternion)
            raise UserError(f"{file}, key vec_quat.{frame}: has length {length:.3g}, not 1; record it again")
    poses = {frame: _pose(record.vec_pos[frame], record.vec_quat[frame]) for frame in frames.names}
    return Action(record.type, poses, dict(record.sigma))


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


def _numbers(values: Sequence[float]) -> list[float]:
    """Round to 0.01 mm, finer than anybody can place."""
    return [round(float(value), 5) + 0.0 for value in values]
