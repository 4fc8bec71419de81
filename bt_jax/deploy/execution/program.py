"""What the robot is to execute: a task and a tree, from a run folder or a tree file, read without the training's code."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Tree, check_names, expand
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import one_line
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import Task, load_task, task_from_dict

__all__ = ["Program", "load_program"]


@dataclasses.dataclass(frozen=True)
class Program:
    """A tree and the task that its leaves speak of."""

    task: Task
    tree: Tree

    def __post_init__(self) -> None:
        for node in prefix(expand(self.tree)):
            if isinstance(node, Behavior):
                check_names(node, self.task)

    @property
    def digest(self) -> str:
        """SHA-256 of the tree in its text form, hexadecimal: equal for equal trees only."""
        return hashlib.sha256(one_line(self.tree).encode()).hexdigest()


def load_program(source: Path, task: str | None = None) -> Program:
    """Reads a run folder, or a tree as .txt or .xml; `task` (a name or a YAML file) comes before the run folder's own.

    A tree file needs no task where it is meant for `yumi_stack`. Raises UserError where there is no tree, no task, or the
    tree names what the task does not have.
    """
    if not source.is_dir():
        return Program(load_task(task or "yumi_stack"), read_tree(source))
    tree = source / "best_tree.txt"
    if not tree.is_file():
        raise UserError(f"{source} holds no best_tree.txt; give a folder that bt_jax.train has finished")
    return Program(_task_of(source) if task is None else load_task(task), read_tree(tree))


def _task_of(folder: Path) -> Task:
    config = folder / "config.json"
    try:
        data = json.loads(config.read_text(encoding="utf-8"))["task"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{config} cannot be read ({error}); restore it, or name the task with --task") from error
    return task_from_dict(data, source=str(config))
