"""Everything needed to repeat a run, and its file, `config.json`."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
from pathlib import Path
from typing import Any

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.json_files import read_json
from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task, task_from_dict
from bt_jax.training.settings import Settings

__all__ = ["RunConfig", "package_version", "parse_leaf"]

FORMAT = 2


def package_version() -> str:
    """Return the version of this package."""
    return importlib.metadata.version("bt_jax")


@dataclasses.dataclass(frozen=True)
class _Content:
    """What `config.json` holds; what has a default is missing in older files."""

    format: int
    version: str
    task: Any
    gp: GPConfig
    settings: Settings
    baseline: str | None
    extra_leaves: list[str]
    phase: int
    since: int
    x64: bool = False
    without: list[str] = dataclasses.field(default_factory=list)


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
    x64: bool = False
    """whether JAX computed with 64-bit numbers, which the commands never do"""
    without: tuple[Behavior, ...] = ()
    """leaves of the task's gene pool that are not used"""

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
            "x64": self.x64,
            "without": list(map(str, self.without)),
        }
        return json.dumps(data, indent=2) + "\n"

    @staticmethod
    def read(source: Path) -> RunConfig:
        """Return the configuration in a file. Raise UserError if it is damaged or of another version."""
        return RunConfig.of(read_json(source), source)

    @staticmethod
    def of(data: Any, source: Path) -> RunConfig:
        """Return the configuration that plain data describes. Raise UserError, naming `source`, as `read` does."""
        found = data.get("format") if isinstance(data, dict) else None
        if isinstance(found, int) and found != FORMAT:
            raise UserError(
                f"{source} has format {found} and this version reads {FORMAT}; use the version that wrote it"
            )
        try:
            content = decode(_completed(data), _Content, source)
            baseline = None if content.baseline is None else parse_tree(content.baseline)
            extra, without = (tuple(map(parse_leaf, texts)) for texts in (content.extra_leaves, content.without))
            task = task_from_dict(content.task, source=str(source), kept=True)
        except UserError as error:
            version = data.get("version") if isinstance(data, dict) else None
            if isinstance(version, str) and version != package_version():
                raise UserError(
                    f"{source} was written by version {version} and this is {package_version()}; use that version"
                ) from error
            named = str(error) if str(source) in str(error) else f"{source} is damaged ({error}); restore it"
            raise UserError(named) from error
        return RunConfig(
            task,
            content.gp,
            content.settings,
            baseline,
            extra,
            content.phase,
            content.since,
            content.version,
            content.x64,
            without,
        )


def _completed(data: Any) -> Any:
    """Return the data with the method that older files do not name: there was only one."""
    gp = data.get("gp") if isinstance(data, dict) else None
    return {**data, "gp": {"method": "population", **gp}} if isinstance(gp, dict) else data


def parse_leaf(text: str) -> Behavior:
    """Return a tree of one leaf. Raise UserError if the text is not one."""
    leaf = parse_tree(text)
    if not isinstance(leaf, Behavior):
        raise UserError(f"'{text}' is not a single leaf")
    return leaf
