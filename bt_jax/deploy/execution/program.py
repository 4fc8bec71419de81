"""What the robot is to execute: a task and a tree, from a folder of train or learn, or a tree file."""

from __future__ import annotations

import dataclasses
import hashlib
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Tree, check_names, expand
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import one_line
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import Task, load_task, task_of_folder

__all__ = ["Program", "load_program", "refuse_driving"]


@dataclasses.dataclass(frozen=True)
class Program:
    """A tree and the task that its leaves speak of."""

    task: Task
    tree: Tree

    def __post_init__(self) -> None:
        refuse_driving(self.task)
        for node in prefix(expand(self.tree)):
            if isinstance(node, Behavior):
                check_names(node, self.task)

    @property
    def digest(self) -> str:
        """SHA-256 of the tree in its text form, hexadecimal: equal for equal trees only."""
        return hashlib.sha256(one_line(self.tree).encode()).hexdigest()


def refuse_driving(task: Task) -> Task:
    """Return a task. Raise UserError if its robot drives."""
    if task.robot.base is not None:
        raise UserError(f"the robot of task {task.name} drives, and this one does not; use a task without robot.base")
    return task


def load_program(source: Path, task: str | None = None, *, otherwise: str | None = None) -> Program:
    """Return the tree and the task of a folder that `train` or `learn` has written, or the tree in a .txt or .xml file.

    `task` (a name or a YAML file) comes before the folder's own; a file's is `otherwise` if none is given. Raise UserError
    if there is no tree, if it names what the task does not have, or if nothing says which task it is for.
    """
    tree = read_tree(source)
    name = task or (None if source.is_dir() else otherwise)
    if name is not None:
        return Program(load_task(name), tree)
    own = task_of_folder(source) if source.is_dir() else None
    if own is None:
        raise UserError(f"{source} does not say which task its tree is for; name the task with --task")
    return Program(own, tree)
