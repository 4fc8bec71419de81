"""What a training is told to do: command lines of `bt_jax.train`, and the files that they name."""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path

import yaml

from bt_jax._util.errors import UserError
from bt_jax.encoding.formats.text import format_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes

__all__ = ["TrainCommand"]


class TrainCommand:
    """Makes command lines. What they name is written to a temporary folder, which goes with this object."""

    def __init__(self) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="bt_jax-")

    def start(self, task: Task, gp: GPConfig, out: Path | None = None) -> list[str]:
        """A new run, into a folder: the task as a file, and every setting that is not the default."""
        words = ["--task", self._written(f"{task.name}.yaml", yaml.safe_dump(task.to_dict(), sort_keys=False))]
        for field in dataclasses.fields(gp):
            value, option = getattr(gp, field.name), field.name.replace("_", "-")
            if value == field.default:
                continue
            if isinstance(value, bool):
                words.append(f"--{option}" if value else f"--no-{option}")
            else:
                words += [f"--{option}", getattr(value, "name", str(value))]
        return words if out is None else [*words, "--out", str(out.resolve())]

    def go_on(self, run: Path, generations: int, changes: Changes = Changes()) -> list[str]:  # noqa: B008
        """The same run, up to a generation; where there are changes, in a new phase."""
        words = ["--resume", str(run.resolve()), "--generations", str(generations)]
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
        """Path of a file for the process to read. It is not forced to the disk, which would take long."""
        try:
            source = Path(tempfile.mkdtemp(dir=self._scratch.name)) / name
            source.write_text(text, encoding="utf-8")
        except OSError as error:
            raise UserError(f"{self._scratch.name} cannot be written ({error.strerror}); free some space") from None
        return str(source)
