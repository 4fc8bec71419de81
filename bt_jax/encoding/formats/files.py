"""Reading a tree from a file, whichever format it is in."""

from __future__ import annotations

from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import parse_tree

__all__ = ["read_tree"]


def read_tree(path: Path) -> Tree:
    """Read a tree from a .txt or .xml file. Raise UserError, naming the file, if it holds none."""
    if not path.exists():
        raise UserError(f"there is no file or folder {path}; give a run folder, or a tree as .txt or .xml")
    if path.suffix.lower() == ".xml":
        from bt_jax.encoding.formats.xml import from_xml  # imports JAX, which a robot's program does without

        return from_xml(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path} cannot be read ({error}); give a tree as .txt or .xml") from error
    try:
        return parse_tree(text)
    except UserError as error:
        raise UserError(f"{path}, {error}") from error
