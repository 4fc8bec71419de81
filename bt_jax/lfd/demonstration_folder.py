"""Demonstrations on the disk, in the published format:

    FOLDER/info.yaml            frames, default_frame, robot
    FOLDER/task.yaml            the task in which they were recorded (not part of the format)
    FOLDER/demo1/data_1.yaml    one action, see `demonstration_files`

Beyond it, `info.yaml` may say in which task they were recorded (`task`, `boxes`: the size of each object, one number for a
cube, radius and height for a cylinder, three edges otherwise), the `order` of the demonstrations where that is not the one
of their names, `left_out`, those that nothing is to be learnt from, what a person has corrected (see `correction_file`),
`after`, the run folder whose tree was executed before they began, and `next_layout`, the number of the first random layout
that no demonstration has begun in.
"""

from __future__ import annotations

import contextlib
import dataclasses
import re
import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.files import NAME_RULE, is_name, write_atomic
from bt_jax._util.yaml_files import to_yaml
from bt_jax.lfd.correction_file import corrections_of, forgotten, renamed, said_of
from bt_jax.lfd.corrections import Corrections, Instance
from bt_jax.lfd.demonstration import Demonstration, Demonstrations, Frames
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
        frames = self.frames()
        good: list[Demonstration] = []
        problems = [] if is_described(self.path) else [f"{self.path / 'info.yaml'} is missing or empty: {REBUILT}."]
        names = [name for name in self.names() if name not in self.left_out()]
        for name in names:
            try:
                one = read_demonstration(self.path / name, frames)
            except UserError as error:
                deleted = "" if isinstance(error, StrayFile) else f", or delete {self.path / name}"
                problems.append(f"{name} is left out: {error}{deleted}.")
                continue
            good.append(one)
        if not names and self.names():
            raise UserError(f"every demonstration in {self.path} is left out; take one in again")
        if not good:
            raise UserError(_none_usable(self.path, [problem for problem in problems if REBUILT not in problem]))
        said = corrections_of(self._info(), [one.name for one in good])
        return Demonstrations(frames, tuple(good), tuple(problems), _possible(said, good, frames))

    def correct(self, demonstrations: Demonstrations, corrections: Corrections) -> None:
        """Keep what a person has said about demonstrations that were read from here. Raise UserError if one of them has
        gone, or if there is no such frame."""
        frames = self.frames()
        for frame in corrections.frames.values():
            if frame not in frames.names:
                raise UserError(f"there is no frame '{frame}'; use one of {', '.join(frames.names)}")
        self._keep(demonstrations, corrections, Corrections.__or__)

    def take_back(self, demonstrations: Demonstrations, corrections: Corrections) -> None:
        """Keep nothing any more of what these corrections speak of. Raise UserError if a demonstration has gone."""
        self._keep(demonstrations, corrections, Corrections.without)

    def _keep(
        self,
        demonstrations: Demonstrations,
        corrections: Corrections,
        change: Callable[[Corrections, Corrections], Corrections],
    ) -> None:
        names = self.names()
        known = [one.name for one in demonstrations]
        for d in sorted(corrections.demonstrations):
            self._existing(known[d])
        numbers = {d: names.index(name) for d, name in enumerate(known) if name in names}
        changed = change(corrections_of(self._info(), names), corrections.renumbered(numbers))
        self._change(**said_of(changed, names))

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
        source, info = self._existing(name), self._info()
        # Both names are known to `info.yaml` while the folder is renamed, so that nothing is lost at any moment.
        order = [other for known in self.names() for other in ((new, known) if known == name else (known,))]
        left_out = [*self.left_out(), *([new] if name in self.left_out() else [])]
        self._change(order=order, left_out=left_out, **renamed(info, {name: (name, new)}))
        try:
            source.rename(self.path / new)
        except OSError as error:
            raise UserError(f"{source} cannot be renamed ({error.strerror}); check who may write there") from None
        self._change(
            order=[other for other in order if other != name],
            left_out=[other for other in left_out if other != name],
            **renamed(info, {name: (new,)}),
        )

    def _highest(self) -> int:
        """Return the greatest N of the demonstrations called demoN, 0 if there are none."""
        return max((int(name[4:]) for name in self.names() if re.fullmatch(r"demo\d+", name)), default=0)

    def _info(self) -> Mapping[str, Any]:
        return read_info(self.path)

    def _order(self) -> list[str]:
        order = self._info().get("order")
        return [name for name in order if isinstance(name, str)] if isinstance(order, list) else []

    def _forget(self, name: str) -> None:
        """Remove from `info.yaml` whatever is about a demonstration of this name."""
        self._change(
            order=[other for other in self._order() if other != name],
            left_out=[other for other in self.left_out() if other != name],
            **forgotten(self._info(), name),
        )

    def _change(self, **values: Any) -> None:
        """Replace keys of `info.yaml`, leaving out what says nothing."""
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


def _possible(said: Corrections, demonstrations: Sequence[Demonstration], frames: Frames) -> Corrections:
    """Return what is about actions and frames that there are."""
    counts = [len(one.actions) for one in demonstrations]

    def there(*instances: Instance) -> bool:
        return all(one.index < counts[one.demonstration] for one in instances)

    return Corrections(
        {one: frame for one, frame in said.frames.items() if there(one) and frame in frames.names},
        {one: turn for one, turn in said.turns.items() if there(one)},
        {(a, b): meant for (a, b), meant in said.orders.items() if there(a, b)},
        said.itself,
    )
