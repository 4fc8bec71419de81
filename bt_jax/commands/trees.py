"""Trees that a command is given, against the task that it works in."""

from __future__ import annotations

from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree, check_names
from bt_jax.encoding.walk import leaves
from bt_jax.tasks import Task

__all__ = ["check_tree"]


def check_tree(tree: Tree, task: Task, source: Path) -> None:
    """Raise UserError, naming the source of a tree, if a leaf names what the task does not have."""
    try:
        for leaf in leaves(tree):
            check_names(leaf, task)
    except UserError as error:
        raise UserError(f"{source}: {error}") from error
