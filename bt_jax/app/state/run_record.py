"""Everything that a run folder holds, read at once; what is missing or cannot be read is None."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.json_files import read_json
from bt_jax._util.statistics import wilson
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.training.progress import Progress, read_progress
from bt_jax.training.result import Failures
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import RunNote, read_note

__all__ = [
    "RunRecord",
    "Success",
    "failures",
    "read_record",
    "read_records",
    "read_result",
    "success",
    "tested",
    "works",
]

T = TypeVar("T")
MOST = 0.75  # of the episodes in which things go wrong; no tree solves all of them


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """A run: its configuration, its progress, the best tree, and `result.json` if that tree was tested."""

    name: str
    config: RunConfig
    progress: Progress | None
    tree: Tree | None
    result: dict[str, Any] | None
    phases: tuple[int, ...]
    note: RunNote = dataclasses.field(default_factory=RunNote)

    @property
    def title(self) -> str:
        """What a person calls it: the name that it was given, or else that of its folder."""
        return self.note.name or self.name


@dataclasses.dataclass(frozen=True)
class Success:
    """Of the `tried` episodes of a test, the best tree `solved` so many; with a coverage of 95 %, it solves between `low`
    and `high`, shares of 1, of all there could be."""

    solved: int
    tried: int
    low: float
    high: float

    def __str__(self) -> str:
        """Return "97 of 100 (95 %: 91.5 to 99.0 %)"."""
        return f"{self.solved} of {self.tried} (95 %: {100 * self.low:.1f} to {100 * self.high:.1f} %)"


def success(result: dict[str, Any]) -> Success:
    """Return how often the best tree works, from `result.json`."""
    tried = result["test_layouts"] * result.get("test_draws", 1)
    solved = round(result["success_rate"] * tried)
    return Success(solved, tried, *wilson(solved, tried))


def failures(result: dict[str, Any]) -> tuple[Failures, ...]:
    """Return in which episodes of its test the best tree fails, and why, the commonest reason first; nothing if the file is
    older than that, or damaged."""
    try:
        return decode({"failures": result.get("failures", [])}, _Failing, "result.json").failures
    except UserError:
        return ()


@dataclasses.dataclass(frozen=True)
class _Failing:
    failures: tuple[Failures, ...]


def tested(result: dict[str, Any]) -> str:
    """Say in how many episodes of the test the best tree works: one in each layout, or several where things go wrong."""
    found = success(result)
    return f"{found.solved} of {found.tried}"


def works(result: dict[str, Any]) -> bool:
    """Return whether the best tree works: in every start of the test, or where things go wrong, in most episodes."""
    return result["success_rate"] >= (1 if result.get("test_draws", 1) == 1 else MOST)


def read_record(folder: RunFolder) -> RunRecord:
    """Read a run folder. Raise UserError if its configuration is missing or damaged."""
    config, progress = folder.config(), read_progress(folder.path)
    if progress is None or progress.best is None:
        progress = _or_none(lambda: _from_history(folder)) or progress
    tree = None if progress is None else _or_none(functools.partial(parse_tree, progress.tree))
    tree = tree or _or_none(folder.tree)
    phases, note = tuple(folder.phases()), read_note(folder.path)
    return RunRecord(folder.path.name, config, progress, tree, read_result(folder), phases, note)


def read_records(workspace: Workspace) -> tuple[dict[str, RunRecord], dict[str, UserError]]:
    """Return the runs of a workspace that can be read, the newest first, and for each of the others why it cannot."""
    records: dict[str, RunRecord] = {}
    problems: dict[str, UserError] = {}
    for name in workspace.run_names():
        try:
            records[name] = read_record(workspace.run(name))
        except UserError as error:
            problems[name] = error
    return records, problems


def read_result(folder: RunFolder) -> dict[str, Any] | None:
    """Read `result.json`."""
    found = _or_none(lambda: read_json(folder.path / "result.json"))
    if not isinstance(found, dict) or not all(type(found.get(key, 1)) is int for key in ("test_layouts", "test_draws")):
        return None
    if found.get("test_layouts", 0) < 1 or found.get("test_draws", 1) < 1:
        return None
    rate = found.get("success_rate")
    return found if isinstance(rate, float) and 0 <= rate <= 1 else None


def _from_history(folder: RunFolder) -> Progress:
    """Return the progress of a run that did not report any."""
    history = folder.history()
    last = history[-1].generation if history else 0
    return Progress(0, "finished", generations=last, tree=one_line(folder.tree())).with_history(history)


def _or_none(read: Callable[[], T]) -> T | None:
    try:
        return read()
    except UserError:
        return None
