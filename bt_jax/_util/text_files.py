"""Reading the text files that people make with any editor: which encoding, and what the file begins with."""

from __future__ import annotations

import codecs
import stat
from pathlib import Path

from bt_jax._util.errors import UserError

__all__ = ["decode_text", "read_bytes", "read_text"]

# The marks that editors put at the beginning; that of UTF-32 begins with that of UTF-16.
MARKS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF32_LE: "utf-32-le",
    codecs.BOM_UTF32_BE: "utf-32-be",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}


def read_text(path: Path) -> str:
    """Return the text of a file in UTF-8, or in UTF-16 or UTF-32 with a byte order mark; lines end with a newline only.

    Other encodings are refused: they look alike, so guessing would change names without a word. Raise UserError, naming
    the file, if it cannot be read or is not such a text.
    """
    return decode_text(read_bytes(path), str(path))


def read_bytes(path: Path) -> bytes:
    """Return what a file holds. Raise UserError, naming the file, if it cannot be read; a pipe or a device may never end."""
    try:
        kind = path.stat().st_mode
        if not stat.S_ISREG(kind) and not stat.S_ISDIR(kind):
            raise UserError(f"{path} is a pipe or a device; give a file")
        return path.read_bytes()
    except FileNotFoundError as error:
        raise UserError(f"there is no file {path}; check the path") from error
    except IsADirectoryError as error:
        raise UserError(f"{path} is a folder; give a file") from error
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror}); check the file and its permissions") from error
    except ValueError as error:
        raise UserError(f"{str(path)!r} cannot be a path ({error}); check it") from error


def decode_text(data: bytes, where: str) -> str:
    """Return the text that bytes stand for, as `read_text` does; `where` names them in the error."""
    mark = next((mark for mark in MARKS if data.startswith(mark)), b"")
    encoding = MARKS.get(mark, "utf-8")
    data = data[len(mark) :]
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data[: error.start].decode(encoding, "replace").count("\n") + 1
        raise UserError(f"{where}, line {line}: not {encoding.upper()} text; save the file as UTF-8") from error
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise UserError(f"{where}, line {line}: holds a NUL character, so it is not a text; save the file as UTF-8")
    return text.replace("\r\n", "\n").replace("\r", "\n")
