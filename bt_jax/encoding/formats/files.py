"""Reading a tree from a file, whichever format it is in, or from a folder that holds one."""

from __future__ import annotations

from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_text
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml

__all__ = ["read_tree"]


LEARNT = ("best_tree.txt", "learnt_tree.txt")  # what train and learn write


def read_tree(path: Path) -> Tree:
    """Return the tree in a .txt or .xml file, or in a folder that `train` or `learn` has written.

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
    text = read_text(path)
    try:
        return parse_tree(text)
    except UserError as error:
        raise UserError(f"{path}, {error}") from error
