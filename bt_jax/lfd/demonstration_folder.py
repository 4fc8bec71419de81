"""Demonstrations on the disk, in the published format:

    FOLDER/info.yaml            frames, default_frame, robot
    FOLDER/task.yaml            the task in which they were recorded (not part of the format)
    FOLDER/demo1/data_1.yaml    one action, see `demonstration_files`

Beyond it, `info.yaml` may say in which task they were recorded (`task`, `boxes`: the size of each), the `order` of the
demonstrations where that is not the one of their names, `chosen`, the frames that a person has chosen for actions, and
`after`, the run folder whose tree was executed before they began.
"""

from __future__ import annotations

import dataclasses
import re
import shutil
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.files import NAME_RULE, is_name, write_atomic
from bt_jax._util.yaml_files import to_yaml
from bt_jax.lfd.demonstration import Demonstration, Demonstrations, Frames, Instance, RecordedTask
from bt_jax.lfd.demonstration_files import (
    HUGE,
    Unusable,
    problem_of,
    read_demonstration,
    read_mapping,
    write_demonstration,
)
from bt_jax.tasks import Task, load_task, task_names, task_of_folder

__all__ = ["DemonstrationFolder"]


@dataclasses.dataclass(frozen=True)
class DemonstrationFolder:
    """A folder in the published format; no demonstration in it is ever overwritten."""

    path: Path

    def create(self, frames: Frames) -> None:
        """Write `info.yaml`, or check that the one there says the same; and the task, unless one is there or the
        demonstrations that are there were recorded in another."""
        recorded, same_task = frames.recorded, True
        if (self.path / "info.yaml").exists():
            known = self.frames()
            if known != frames:
                raise UserError(f"{self.path} holds demonstrations with other frames; choose another folder")
            same_task = recorded is not None and known.recorded is not None and known.recorded.name == recorded.name
            if recorded is not None and known.recorded is not None and known.recorded.boxes != recorded.boxes:
                raise UserError(f"{self.path} holds demonstrations with boxes of other sizes; choose another folder")
        else:
            info: dict[str, Any] = {
                "default_frame": frames.default,
                "frames": list(frames.names),
                "robot": frames.robot,
            }
            if recorded is not None:
                info |= {"task": recorded.name, "boxes": dict(recorded.boxes)}
            write_atomic(self.path / "info.yaml", to_yaml(info))
        task = None if recorded is None else recorded.task
        if task is not None and same_task and not (self.path / "task.yaml").exists():
            write_atomic(self.path / "task.yaml", to_yaml(task.to_dict()))

    def frames(self) -> Frames:
        """Read `info.yaml`. Raise UserError if it is missing or incomplete."""
        source, data = self.path / "info.yaml", self._info()
        names, default, robot = data.get("frames"), data.get("default_frame"), data.get("robot")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            raise UserError(f"{source}: frames must be a list of names; fix it")
        if len(set(names)) < len(names) or len(names) < 2:
            raise UserError(f"{source}: frames must name at least two frames, each once; fix it")
        for key, name in (("default_frame", default), ("robot", robot)):
            if name not in names:
                raise UserError(f"{source}: {key} '{name}' is not one of the frames; use one of {', '.join(names)}")
        return Frames(tuple(names), str(default), str(robot), _recorded(data, source))

    def task(self) -> Task | None:
        """Return the task in which they were recorded: the one that is kept here, or else the one of that name which comes
        with the package. Return None if there is neither; raise UserError if what is here cannot be read."""
        kept = task_of_folder(self.path)
        if kept is not None or not (self.path / "info.yaml").is_file():
            return kept
        recorded = self.frames().recorded
        return load_task(recorded.name) if recorded is not None and recorded.name in task_names() else None

    def names(self) -> list[str]:
        """Return the demonstrations: in the order that `info.yaml` may say, then in natural order, demo2 before demo10."""
        found = [path.name for path in self.path.iterdir() if path.is_dir() and not path.name.startswith(".")]
        order = self._order() if (self.path / "info.yaml").is_file() else []
        return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), _natural(name)))

    def read(self) -> Demonstrations:
        """Return all demonstrations that can be used, and for each of the others a sentence. Raise UserError if none can."""
        frames, chosen = self.frames(), self._chosen()
        good: list[Demonstration] = []
        problems, frame_of = [], {}
        for name in self.names():
            try:
                one = read_demonstration(self.path / name, frames)
            except Unusable as problem:
                problems.append(str(problem))
                continue
            for number, frame in chosen.get(name, {}).items():
                if number <= len(one.actions) and frame in frames.names:
                    frame_of[Instance(len(good), number - 1)] = frame
            good.append(one)
        if not good:
            raise UserError(" ".join(problems) if problems else f"{self.path} holds no demonstration; record some")
        return Demonstrations(frames, tuple(good), tuple(problems), frame_of)

    def choose(self, demonstrations: Demonstrations, instances: Collection[Instance], frame: str | None) -> None:
        """Record that a person has chosen a frame for actions of demonstrations read from here; None takes that back.

        Raise UserError if one of them has gone, or if there is no such frame.
        """
        frames, chosen = self.frames(), {name: dict(actions) for name, actions in self._chosen().items()}
        if frame is not None and frame not in frames.names:
            raise UserError(f"there is no frame '{frame}'; use one of {', '.join(frames.names)}")
        for instance in instances:
            name = self._existing(demonstrations.demonstrations[instance.demonstration].name).name
            chosen.setdefault(name, {}).pop(instance.index + 1, None)
            if frame is not None:
                chosen[name][instance.index + 1] = frame
        self._change(chosen=chosen)

    def remember_run(self, run: Path) -> None:
        """Record the run folder whose tree was executed before the demonstrations began."""
        self._change(after=str(run.resolve()))

    def run(self) -> Path | None:
        """Return the run folder that was recorded so, None if there is none or if it is not there any more."""
        after = self._info().get("after")
        return Path(after) if isinstance(after, str) and (Path(after) / "config.json").is_file() else None

    def append(self, demonstration: Demonstration) -> Demonstration:
        """Add a demonstration under the next free name demoN, whole or not at all, and return it under that name."""
        frames = self.frames()
        numbers = [int(name[4:]) for name in self.names() if re.fullmatch(r"demo\d+", name)]
        named = dataclasses.replace(demonstration, name=f"demo{max(numbers, default=0) + 1}")
        if (problem := problem_of(named, frames, where=named.name)) is not None:
            raise UserError(problem)
        part = self.path / f".{named.name}.part"
        shutil.rmtree(part, ignore_errors=True)
        write_demonstration(part, named)
        self._forget(named.name)
        part.rename(self.path / named.name)
        return named

    def delete(self, name: str) -> None:
        """Remove one demonstration, whole or not at all. Raise UserError if there is none of that name."""
        source = self._existing(name)
        gone = self.path / f".{name}.deleted"
        shutil.rmtree(gone, ignore_errors=True)
        try:
            source.rename(gone)
        except OSError as error:
            raise UserError(f"{source} cannot be deleted ({error.strerror}); check who may write there") from None
        shutil.rmtree(gone, ignore_errors=True)
        self._forget(name)

    def rename(self, name: str, new: str) -> None:
        """Give a demonstration another name; it stays where it is in the order. Raise UserError if that is taken or no
        name."""
        if not is_name(new):
            raise UserError(f"'{new}' cannot name a demonstration; use {NAME_RULE}")
        if (self.path / new).exists():
            raise UserError(f"{self.path / new} exists already; choose another name")
        source, chosen = self._existing(name), dict(self._chosen())
        # Both names are known to `info.yaml` while the folder is renamed, so that nothing is lost at any moment.
        order = [other for known in self.names() for other in ((new, known) if known == name else (known,))]
        self._change(order=order, chosen={**chosen, **({new: chosen[name]} if name in chosen else {})})
        try:
            source.rename(self.path / new)
        except OSError as error:
            raise UserError(f"{source} cannot be renamed ({error.strerror}); check who may write there") from None
        chosen[new] = chosen.pop(name, {})
        self._change(order=[other for other in order if other != name], chosen=chosen)

    def _info(self) -> Mapping[str, Any]:
        """Return what is in `info.yaml`. Raise UserError if that cannot be read."""
        source = self.path / "info.yaml"
        if not self.path.is_dir():
            raise UserError(f"there is no folder {self.path}; give one with demonstrations, or record some into it")
        if not source.is_file():
            raise UserError(f"{source} is missing; restore it, or record the demonstrations into a new folder")
        try:
            return read_mapping(source)
        except Unusable as problem:
            raise UserError(str(problem).removesuffix(".")) from None

    def _order(self) -> list[str]:
        order = self._info().get("order")
        return [name for name in order if isinstance(name, str)] if isinstance(order, list) else []

    def _chosen(self) -> Mapping[str, Mapping[int, str]]:
        """Return for each demonstration the chosen frame of each action, counted from 1."""
        chosen = self._info().get("chosen")
        if not isinstance(chosen, Mapping):
            return {}
        return {
            name: {number: frame for number, frame in actions.items() if isinstance(number, int) and number > 0}
            for name, actions in chosen.items()
            if isinstance(actions, Mapping)
        }

    def _forget(self, name: str) -> None:
        """Remove from `info.yaml` whatever is about a demonstration of this name."""
        self._change(
            order=[other for other in self._order() if other != name],
            chosen={other: actions for other, actions in self._chosen().items() if other != name},
        )

    def _change(self, **values: Any) -> None:
        """Replace keys of `info.yaml`, leaving out what says nothing."""
        values = {**values, **({"chosen": _without_empty(values["chosen"])} if "chosen" in values else {})}
        if "order" in values and values["order"] == sorted(values["order"], key=_natural):
            values["order"] = []
        info = dict(self._info())
        changed = {key: value for key, value in {**info, **values}.items() if value or key not in values}
        if changed != info:
            write_atomic(self.path / "info.yaml", to_yaml(changed))

    def _existing(self, name: str) -> Path:
        self.frames()
        if name not in self.names():
            raise UserError(f"{self.path} has no demonstration '{name}'; it has {', '.join(self.names()) or 'none'}")
        return self.path / name


def _recorded(data: Mapping[str, Any], source: Path) -> RecordedTask | None:
    """Return in which task the demonstrations were recorded, None if the file does not say."""
    task, boxes = data.get("task"), data.get("boxes")
    if task is None and boxes is None:
        return None
    sizes = boxes.items() if isinstance(boxes, Mapping) else ()
    if (
        not isinstance(task, str)
        or not sizes
        or not all(type(size) in (int, float) and 0 < size < HUGE for _, size in sizes)
    ):
        raise UserError(f"{source}: task must be a name and boxes the size of each; fix both, or remove them")
    return RecordedTask(task, {str(name): float(size) for name, size in sizes})


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """Return what names are sorted by so that demo2 comes before demo10."""
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", name)]


def _without_empty(chosen: Mapping[str, Mapping[int, str]]) -> dict[str, dict[int, str]]:
    return {name: dict(actions) for name, actions in chosen.items() if actions}
