"""Demonstrations on the disk, in the published format:

    FOLDER/info.yaml            frames, default_frame, robot
    FOLDER/task.yaml            the task in which they were recorded (not part of the format)
    FOLDER/demo1/data_1.yaml    one action, see `demonstration_files`

Beyond it, `info.yaml` may say in which task they were recorded (`task`, `boxes`: the size of each object, one number for a
cube, radius and height for a cylinder, three edges otherwise), the `order` of the demonstrations where that is not the one
of their names, `left_out`, those that nothing is to be learnt from, `chosen`, the frames that a person has chosen for
actions, `after`, the run folder whose tree was executed before they began, and `next_layout`, the number of the first random
layout that no demonstration has begun in.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
import shutil
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.files import NAME_RULE, is_name, write_atomic
from bt_jax._util.yaml_files import to_yaml
from bt_jax.lfd.demonstration import Demonstration, Demonstrations, Frames, Instance
from bt_jax.lfd.demonstration_files import StrayFile, problem_of, read_demonstration, write_demonstration
from bt_jax.lfd.demonstration_info import REBUILT, info_frames, info_of, is_described, read_info
from bt_jax.tasks import Task, load_task, task_names, task_of_folder

__all__ = ["DemonstrationFolder"]


@dataclasses.dataclass(frozen=True)
class DemonstrationFolder:
    """A folder in the published format; no demonstration in it is ever overwritten."""

    path: Path

    def create(self, frames: Frames) -> None:
        """Write `info.yaml`, or check that the one there says the same; and the task, unless one is there or the
        demonstrations that are there were recorded in another."""
        recorded, same_task, known = frames.recorded, True, frames
        described = is_described(self.path)
        if described or (self.path.is_dir() and self.names()):
            known = self.frames()
            if dataclasses.replace(known, names=frames.names) != frames or {*known.names} != {*frames.names}:
                raise UserError(f"{self.path} holds demonstrations with other frames; choose another folder")
            same_task = recorded is not None and known.recorded is not None and known.recorded.name == recorded.name
            if recorded is not None and known.recorded is not None and known.recorded.boxes != recorded.boxes:
                raise UserError(f"{self.path} holds demonstrations with objects of other sizes; choose another folder")
        if not described:
            write_atomic(self.path / "info.yaml", to_yaml(info_of(known)))
        task = None if recorded is None else recorded.task
        if task is not None and same_task and not (self.path / "task.yaml").exists():
            write_atomic(self.path / "task.yaml", to_yaml(task.to_dict()))

    def frames(self) -> Frames:
        """Read `info.yaml`. Raise UserError if it is missing or incomplete."""
        return info_frames(self._info(), self.path / "info.yaml")

    def task(self) -> Task | None:
        """Return the task in which they were recorded: the one that is kept here, or else the one of that name which comes
        with the package. Return None if there is neither; raise UserError if what is here cannot be read."""
        kept = task_of_folder(self.path)
        if kept is not None or not is_described(self.path):
            return kept
        recorded = self.frames().recorded
        return load_task(recorded.name) if recorded is not None and recorded.name in task_names() else None

    def names(self) -> list[str]:
        """Return the demonstrations: in the order that `info.yaml` may say, then in natural order, demo2 before demo10."""
        found = [path.name for path in self.path.iterdir() if path.is_dir() and not path.name.startswith(".")]
        order: list[str] = []
        with contextlib.suppress(UserError):  # the demonstrations are there, whatever `info.yaml` has come to
            order = self._order() if is_described(self.path) else []
        return sorted(found, key=lambda name: (order.index(name) if name in order else len(order), _natural(name)))

    def read(self) -> Demonstrations:
        """Return all demonstrations that can be used and are not left out, and for each that cannot be used a sentence.
        Raise UserError if there is none."""
        frames, chosen = self.frames(), self._chosen()
        good: list[Demonstration] = []
        frame_of: dict[Instance, str] = {}
        problems = [] if is_described(self.path) else [f"{self.path / 'info.yaml'} is missing or empty: {REBUILT}."]
        names = [name for name in self.names() if name not in self.left_out()]
        for name in names:
            try:
                one = read_demonstration(self.path / name, frames)
            except UserError as error:
                deleted = "" if isinstance(error, StrayFile) else f", or delete {self.path / name}"
                problems.append(f"{name} is left out: {error}{deleted}.")
                continue
            for number, frame in chosen.get(name, {}).items():
                if number <= len(one.actions) and frame in frames.names:
                    frame_of[Instance(len(good), number - 1)] = frame
            good.append(one)
        if not names and self.names():
            raise UserError(f"every demonstration in {self.path} is left out; take one in again")
        if not good:
            raise UserError(_none_usable(self.path, [problem for problem in problems if REBUILT not in problem]))
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

    def left_out(self) -> tuple[str, ...]:
        """Return the demonstrations that are kept, but that nothing is to be learnt from."""
        names = self._info().get("left_out") if is_described(self.path) else None
        return tuple(name for name in names if isinstance(name, str)) if isinstance(names, list) else ()

    def leave_out(self, name: str, left_out: bool = True) -> None:
        """Record that nothing is to be learnt from a demonstration, or take it in again. Raise UserError if it has gone."""
        self._existing(name)
        self._change(left_out=[*(other for other in self.left_out() if other != name), *([name] if left_out else [])])

    def remember_run(self, run: Path) -> None:
        """Record the run folder whose tree was executed before the demonstrations began."""
        self._change(after=str(run.resolve()))

    def run(self) -> Path | None:
        """Return the run folder that was recorded so, None if there is none or if it is not there any more."""
        after = self._info().get("after")
        return Path(after) if isinstance(after, str) and (Path(after) / "config.json").is_file() else None

    def next_layout(self) -> int:
        """Return the number of the first random layout that nothing here has been recorded in, even if it was deleted."""
        if not self.path.is_dir():
            return 0
        found: Any = None
        with contextlib.suppress(UserError):
            found = self._info().get("next_layout")
        return found if isinstance(found, int) and found > 0 else max(len(self.names()), self._highest())

    def use_layouts(self, end: int) -> None:
        """Record that the random layouts before number `end` are used."""
        self._change(next_layout=max(end, self.next_layout()))

    def append(self, demonstration: Demonstration) -> Demonstration:
        """Add a demonstration under the next free name demoN, whole or not at all, and return it under that name."""
        frames = self.frames()
        named = dataclasses.replace(demonstration, name=f"demo{self._highest() + 1}")
        if (problem := problem_of(named, frames)) is not None:
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
        left_out = [*self.left_out(), *([new] if name in self.left_out() else [])]
        self._change(
            order=order,
            chosen={**chosen, **({new: chosen[name]} if name in chosen else {})},
            left_out=left_out,
        )
        try:
            source.rename(self.path / new)
        except OSError as error:
            raise UserError(f"{source} cannot be renamed ({error.strerror}); check who may write there") from None
        chosen[new] = chosen.pop(name, {})
        self._change(
            order=[other for other in order if other != name],
            chosen=chosen,
            left_out=[other for other in left_out if other != name],
        )

    def _highest(self) -> int:
        """Return the greatest N of the demonstrations called demoN, 0 if there are none."""
        return max((int(name[4:]) for name in self.names() if re.fullmatch(r"demo\d+", name)), default=0)

    def _info(self) -> Mapping[str, Any]:
        return read_info(self.path)

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
            left_out=[other for other in self.left_out() if other != name],
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


def _none_usable(folder: Path, problems: Sequence[str]) -> str:
    """Say why a folder has no usable demonstration."""
    if not problems:
        return f"{folder} holds no demonstration; record some"
    first = problems[0].removesuffix(".")
    return first if len(problems) == 1 else f"none of {len(problems)} demonstrations can be used: {first}"


def _natural(name: str) -> list[tuple[bool, int, str]]:
    """Return what names are sorted by so that demo2 comes before demo10."""
    return [(part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in re.split(r"(\d+)", name)]


def _without_empty(chosen: Mapping[str, Mapping[int, str]]) -> dict[str, dict[int, str]]:
    return {name: dict(actions) for name, actions in chosen.items() if actions}
