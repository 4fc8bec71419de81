"""Command lines of `bt_jax.train`, and the files that they name.

The files are written to a folder that outlives the page: a training may read them long after the page was closed.
"""

from __future__ import annotations

import contextlib
import dataclasses
import shutil
import tempfile
import time
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.yaml_files import to_yaml
from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.formats.text import format_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes

__all__ = ["ANYWHERE", "NO_CHANGES", "Beginning", "TrainCommand"]

DAY = 24 * 3600.0  # seconds for which the files are kept; a training reads them in its first minutes
NO_CHANGES = Changes()


@dataclasses.dataclass(frozen=True)
class Beginning:
    """Where an evolution begins: at a tree, or with None at random ones; and the leaves that it does without."""

    baseline: Tree | None = None
    without: tuple[Behavior, ...] = ()


ANYWHERE = Beginning()


class TrainCommand:
    """Makes command lines, with their files in `folder`; those of earlier days are deleted."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()
        _clean(self._folder)

    def start(self, task: Task, gp: GPConfig, out: Path | None = None, begin: Beginning = ANYWHERE) -> list[str]:
        """Return the command of a new run into a folder: the task as a file, where to begin, and every setting that is not
        the default."""
        words = ["--task", self._written(f"{task.name}.yaml", to_yaml(task.to_dict()))]
        for field in dataclasses.fields(gp):
            value, option = getattr(gp, field.name), field.name.replace("_", "-")
            if value == field.default:
                continue
            if isinstance(value, bool):
                words.append(f"--{option}" if value else f"--no-{option}")
            else:
                words += [f"--{option}", getattr(value, "name", str(value))]
        if begin.baseline is not None:
            words += ["--baseline", self._written("baseline.txt", format_tree(begin.baseline))]
        if begin.without:
            words += ["--without", *map(str, begin.without)]
        return words if out is None else [*words, "--out", str(out.resolve())]

    def go_on(self, run: Path, generations: int, changes: Changes = NO_CHANGES) -> list[str]:
        """Return the command that continues a run up to a generation; with changes, in a new phase."""
        words = ["--resume", str(run.resolve()), "--generations", str(generations)]
        if changes.task is not None:
            words += ["--task", self._written(f"{changes.task.name}.yaml", to_yaml(changes.task.to_dict()))]
        if changes.baseline is not None:
            words += ["--baseline", self._written("baseline.txt", format_tree(changes.baseline))]
        if changes.target_from is not None:
            words += ["--add-target-from", str(changes.target_from.resolve())]
        if changes.subgoal_from is not None:
            words += ["--add-subgoal-from", str(changes.subgoal_from.resolve())]
        if changes.baseline_index is not None:
            words += ["--baseline-index", str(changes.baseline_index)]
        return words

    def _written(self, name: str, text: str) -> str:
        """Write a file for the training and return its path. It is not forced to the disk, which would take long."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = Path(tempfile.mkdtemp(dir=self._folder)) / name
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise UserError(f"{self._folder} cannot be written ({error.strerror}); free some space") from None
        return str(path)


def _clean(folder: Path) -> None:
    """Delete what was written more than a day ago."""
    for old in folder.glob("*"):
        with contextlib.suppress(OSError):
            if time.time() - old.stat().st_mtime > DAY:
                shutil.rmtree(old)
