"""Reading a tree from a file, whichever format it is in, or from a folder that holds one."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax._util.json_files import read_json
from bt_jax._util.text_files import read_text
from bt_jax.behaviors import Tree, check_names
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.encoding.walk import leaves
from bt_jax.tasks import Task

__all__ = ["LEARNT", "check_tree", "read_tree"]


LEARNT = ("best_tree.txt", "learnt_tree.txt")  # what train and learn write


def read_tree(path: Path) -> Tree:
    """Return the tree in a .txt or .xml file, in one of the .json files of `train` and `learn`, or in a folder that they
    have written.

    Raise UserError, naming the path, if there is none.
    """
    if path.is_dir():
        found = next((path / name for name in LEARNT if (path / name).is_file()), None)
        if found is None:
            raise UserError(
                f"{path} holds no tree; give a tree as .txt or .xml, or a folder that train or learn has finished"
            )
        path = found
    if not path.exists():
        raise UserError(f"there is no file or folder {path}; give a run folder, or a tree as .txt or .xml")
    if path.suffix.lower() == ".xml":
        return from_xml(path)
    text = _text_of(read_json(path), path) if path.suffix.lower() == ".json" else read_text(path)
    try:
        return parse_tree(text)
    except UserError as error:
        raise UserError(f"{path}, {error}") from error


def check_tree(tree: Tree, task: Task, source: Path | str) -> None:
    """Raise UserError, naming the source of a tree, if a leaf names what the task does not have."""
    try:
        for leaf in leaves(tree):
            check_names(leaf, task)
    except UserError as error:
        raise UserError(f"{source}: {error}") from error


def _text_of(data: Any, path: Path) -> str:
    """Return the tree that lesson.json, progress.json or result.json says; of several runs, that of the best."""
    runs = data.get("runs") if isinstance(data, Mapping) else None
    found = [data] if not isinstance(runs, list) else sorted(filter(_is_run, runs), key=lambda run: -run["fitness"])
    text = found[0].get("tree") if found and isinstance(found[0], Mapping) else None
    if not isinstance(text, str):
        raise UserError(f"{path} says no tree; give a .json file of train or learn, or a tree as .txt or .xml")
    return text


def _is_run(data: Any) -> bool:
    return isinstance(data, Mapping) and isinstance(data.get("fitness"), float | int)
