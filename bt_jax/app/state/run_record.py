"""Everything that a run folder holds, read at once; what is missing or cannot be read is None."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any, TypeVar

from bt_jax._util.errors import UserError
from bt_jax._util.json_files import read_json
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.training.progress import Progress, read_progress
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder

__all__ = ["RunRecord", "read_record", "read_records", "read_result", "tested"]

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class RunRecord:
    """A run: its configuration, its progress, the best tree, and `result.json` if that tree was tested."""

    name: str
    config: RunConfig
    progress: Progress | None
    tree: Tree | None
    result: dict[str, Any] | None
    phases: tuple[int, ...]


def tested(result: dict[str, Any]) -> str:
    """Say in how many episodes of the test the best tree works: one in each layout, or several where things go wrong."""
    count = result["test_layouts"] * result.get("test_draws", 1)
    return f"{round(result['success_rate'] * count)} of {count}"


def read_record(folder: RunFolder) -> RunRecord:
    """Read a run folder. Raise UserError if its configuration is missing or damaged."""
    config, progress = folder.config(), read_progress(folder.path)
    if progress is None or progress.best is None:
        progress = _or_none(lambda: _from_history(folder)) or progress
    tree = None if progress is None else _or_none(functools.partial(parse_tree, progress.tree))
    tree = tree or _or_none(folder.tree)
    return RunRecord(folder.path.name, config, progress, tree, read_result(folder), tuple(folder.phases()))


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
    if not isinstance(found, dict) or type(found.get("test_layouts")) is not int:
        return None
    return found if isinstance(found.get("success_rate"), float) else None


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
