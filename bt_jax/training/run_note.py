"""What a person says about a run: a name and a note, in `note.json` of its folder, which a training leaves alone."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from pathlib import Path

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.json_files import read_json

__all__ = ["LONGEST_NAME", "LONGEST_NOTE", "RunNote", "read_note", "write_note"]

FILE = "note.json"
LONGEST_NAME, LONGEST_NOTE = 80, 4000  # characters


@dataclasses.dataclass(frozen=True)
class RunNote:
    """`name` is one line, `note` may have several; both may be empty."""

    name: str = ""
    note: str = ""


def read_note(folder: Path) -> RunNote:
    """Return what was said about the run in a folder, nothing if the file is missing or damaged."""
    with contextlib.suppress(UserError):
        return decode(read_json(folder / FILE), RunNote, folder / FILE)
    return RunNote()


def write_note(folder: Path, note: RunNote) -> None:
    """Replace what was said about a run; white space around it, and line ends in the name, are left out. Raise UserError if
    a text is too long or the folder has gone."""
    name, text = " ".join(note.name.split()), note.note.strip()
    for what, said, longest in (("name", name, LONGEST_NAME), ("note", text, LONGEST_NOTE)):
        if len(said) > longest:
            raise UserError(f"the {what} has {len(said):,} characters; shorten it to {longest:,}")
    if not folder.is_dir():
        raise UserError(f"the run {folder.name} is no longer there; choose another")
    write_atomic(folder / FILE, json.dumps({"name": name, "note": text}, ensure_ascii=False, indent=2) + "\n")
