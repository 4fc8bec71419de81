"""What `info.yaml` says about a folder of demonstrations; if it is lost, the demonstrations themselves tell the frames."""

from __future__ import annotations

import contextlib
import dataclasses
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bt_jax._util.decoding import abridged, decode
from bt_jax._util.errors import UserError
from bt_jax._util.yaml_files import read_yaml
from bt_jax.lfd.demonstration import Frames, RecordedTask, Size
from bt_jax.lfd.demonstration_files import recorded_frames
from bt_jax.tasks import task_of_folder
from bt_jax.tasks.bounds import BOUNDS

__all__ = ["REBUILT", "info_frames", "info_of", "is_described", "read_info"]

ROBOT = "base_link"  # the robot's frame in the published format
REBUILT = "the frames are taken from the demonstrations"
EXAMPLES: Mapping[str, str] = types.MappingProxyType(
    {
        "frames": f"[KittingBox, YellowBox, {ROBOT}]",
        "default_frame": ROBOT,
        "robot": ROBOT,
        "task": "stack3",
        "boxes": "{YellowBox: 0.1}",
    }
)


@dataclasses.dataclass(frozen=True)
class _Frames:
    frames: tuple[str, ...]
    default_frame: str
    robot: str


@dataclasses.dataclass(frozen=True)
class _Recorded:
    task: str
    boxes: Mapping[str, Size]


def is_described(folder: Path) -> bool:
    """Return whether there is an `info.yaml` that is not empty."""
    source = folder / "info.yaml"
    return source.is_file() and source.stat().st_size > 0


def read_info(folder: Path) -> Mapping[str, Any]:
    """Return what `info.yaml` says, or must have said where it is missing or empty. Raise UserError if that is unknown."""
    source = folder / "info.yaml"
    if not folder.is_dir():
        raise UserError(f"there is no folder {folder}; give one with demonstrations, or record some into it")
    if not is_described(folder):
        return _rebuilt(folder)
    try:
        data = read_yaml(source)
    except UserError as error:
        raise UserError(f"{error}, or delete the file: {REBUILT} then") from None
    if not isinstance(data, Mapping):
        raise UserError(f"{source}: expected a mapping, found {abridged(data)}; delete the file: {REBUILT} then")
    return data


def info_frames(info: Mapping[str, Any], source: Path) -> Frames:
    """Return the frames that an `info.yaml` names. Raise UserError if it is incomplete."""
    found = decode(_part(info, _Frames), _Frames, source, examples=EXAMPLES)
    if len(set(found.frames)) < len(found.frames) or len(found.frames) < 2:
        raise UserError(f"{source}, key frames: there must be at least two, each once; correct the list")
    for key in ("default_frame", "robot"):
        if (name := getattr(found, key)) not in found.frames:
            listed = ", ".join(found.frames)
            raise UserError(f"{source}, key {key}: '{name}' is not one of the frames; use one of {listed}")
    return Frames(found.frames, found.default_frame, found.robot, _recorded(info, source))


def info_of(frames: Frames) -> dict[str, Any]:
    """Return what `info.yaml` says of frames."""
    info: dict[str, Any] = {"default_frame": frames.default, "frames": list(frames.names), "robot": frames.robot}
    if frames.recorded is not None:
        sizes = {name: list(size) if isinstance(size, tuple) else size for name, size in frames.recorded.boxes.items()}
        info |= {"task": frames.recorded.name, "boxes": sizes}
    return info


def _recorded(info: Mapping[str, Any], source: Path) -> RecordedTask | None:
    """Return in which task the demonstrations were recorded, None if the file does not say."""
    part = _part(info, _Recorded)
    if all(value is None for value in part.values()):
        return None
    try:
        found = decode(part, _Recorded, source, examples=EXAMPLES)
    except UserError as error:
        raise UserError(f"{error}, or remove the keys task and boxes") from None
    for box, size in found.boxes.items():
        if isinstance(size, tuple) and len(size) not in (2, 3):
            raise UserError(
                f"{source}, key boxes.{box}: a size does not have {len(size)} numbers; write one for a cube, the radius "
                "and height of a cylinder, or three edges"
            )
        for edge in _edges(size):
            if (complaint := BOUNDS["objects.size"].complaint(edge)) is not None:
                raise UserError(f"{source}, key boxes.{box}: {complaint}")
    return RecordedTask(found.task, found.boxes)


def _edges(size: Size) -> tuple[float, ...]:
    if not isinstance(size, tuple):
        return (size,)
    return size if len(size) == 3 else (2 * size[0], size[1])


def _rebuilt(folder: Path) -> Mapping[str, Any]:
    """Return what `info.yaml` must have said: the frames of a demonstration, in the order of the task's if that is kept.

    Raise UserError if no demonstration can be read, or if they do not tell which frame is the robot's.
    """
    source = folder / "info.yaml"
    names: tuple[str, ...] = ()
    for inner in sorted(path for path in folder.iterdir() if path.is_dir() and not path.name.startswith(".")):
        with contextlib.suppress(UserError):
            names = names or recorded_frames(inner)
    if not names:
        raise UserError(f"{source} is missing or empty; restore it, or record demonstrations into a new folder")
    task = task_of_folder(folder)
    if task is not None and set(Frames.of(task).names) == set(names):
        return info_of(Frames.of(task))
    if ROBOT in names:
        return info_of(Frames(names, ROBOT, ROBOT))
    lines = f"'frames: [{', '.join(names)}]', 'default_frame: {names[-1]}' and 'robot: {names[-1]}'"
    raise UserError(f"{source} is missing or empty; write the lines {lines}, or which frame is the robot's")


def _part(info: Mapping[str, Any], kind: type) -> dict[str, Any]:
    """Return the keys that a dataclass has."""
    return {field.name: info[field.name] for field in dataclasses.fields(kind) if field.name in info}
