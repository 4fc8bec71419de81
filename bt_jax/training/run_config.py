"""Everything needed to repeat a run, and its file, `config.json`."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.tasks import Task, task_from_dict
from bt_jax.training.settings import Settings

__all__ = ["RunConfig", "package_version", "parse_leaf"]

FORMAT = 2
T = TypeVar("T", GPConfig, Settings)


def package_version() -> str:
    """Return the version of this package."""
    return importlib.metadata.version("bt_jax")


@dataclasses.dataclass(frozen=True)
class RunConfig:
    """Everything needed to repeat a run.

    A run has several phases if it went on with another task, baseline or gene pool: this is phase number `phase`, which
    begins at generation `since`.
    """

    task: Task
    gp: GPConfig
    settings: Settings
    baseline: Tree | None = None
    extra_leaves: tuple[Behavior, ...] = ()
    phase: int = 0
    since: int = 0
    version: str = dataclasses.field(default_factory=package_version)

    def to_json(self) -> str:
        """Return the text of `config.json`."""
        data = {
            "format": FORMAT,
            "version": self.version,
            "task": self.task.to_dict(),
            "gp": dataclasses.asdict(self.gp),
            "settings": dataclasses.asdict(self.settings),
            "baseline": None if self.baseline is None else one_line(self.baseline),
            "extra_leaves": list(map(str, self.extra_leaves)),
            "phase": self.phase,
            "since": self.since,
        }
        return json.dumps(data, indent=2) + "\n"

    @staticmethod
    def read(source: Path) -> RunConfig:
        """Return the configuration in a file. Raise UserError if it is damaged or of another version."""
        try:
            data = json.loads(source.read_text(encoding="utf-8"))
            found = data["format"]
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise UserError(f"{source} cannot be read; restore it, or train again") from error
        if found != FORMAT:
            raise UserError(
                f"{source.parent} has format {found} and this version reads {FORMAT}; use the version that wrote it"
            )
        try:
            methods = {key: Selection(data["gp"][key]) for key in ("parent_selection", "survivor_selection")}
            gp, settings = _typed(GPConfig, {**data["gp"], **methods}), _typed(Settings, data["settings"])
            baseline = None if data["baseline"] is None else parse_tree(data["baseline"])
            extra = tuple(parse_leaf(text) for text in data["extra_leaves"])
            phase, since, version, task = int(data["phase"]), int(data["since"]), str(data["version"]), data["task"]
        except KeyError as error:
            raise UserError(f"{source} is damaged (no {error}); restore it, or train again") from error
        except (TypeError, AttributeError, ValueError, UserError) as error:
            raise UserError(f"{source} is damaged ({error}); restore it, or train again") from error
        task = task_from_dict(task, source=str(source))
        return RunConfig(task, gp, settings, baseline, extra, phase, since, version)


def _typed(kind: type[T], values: Mapping[str, Any]) -> T:
    """Return a dataclass of numbers and choices. Raise TypeError if a value does not have the type of its field."""
    hints = typing.get_type_hints(kind)
    for name, value in values.items():
        if name in hints and not _fits(value, hints[name]):
            raise TypeError(f"{name} is {value!r}")
    return kind(**values)


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value has the type: a class, of which a bool is no int, a Literal, or a union of such."""
    if typing.get_origin(hint) is Literal:
        return value in typing.get_args(hint)
    if choices := typing.get_args(hint):
        return any(_fits(value, choice) for choice in choices)
    return type(value) in ((int, float) if hint is float else (hint,))


def parse_leaf(text: str) -> Behavior:
    """Return a tree of one leaf. Raise ValueError if the text is not one."""
    leaf = parse_tree(text)
    if not isinstance(leaf, Behavior):
        raise ValueError(f"{text} is not a leaf")
    return leaf
