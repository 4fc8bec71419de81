"""Writing files so that a reader never meets half of one, names of files, and locks."""

from __future__ import annotations

import contextlib
import errno
import itertools
import os
import re
import secrets
from pathlib import Path
from typing import IO

from bt_jax._util.errors import UserError

__all__ = ["NAME_RULE", "is_name", "try_lock", "unused", "write_atomic"]

NAME_RULE = "letters, digits, spaces, . + - and _, beginning with a letter, a digit or _; at most 100"

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC), errno.EFBIG)  # there is no EDQUOT on Windows


def is_name(text: str) -> bool:
    """Return whether a text can name a file or folder (`NAME_RULE`): within one folder, visible, harmless."""
    return re.fullmatch(r"\w[\w .+-]{0,99}", text) is not None


def unused(path: Path, ending: str = "") -> Path:
    """Return the path, or the first of path-2, path-3, ... that does not exist; numbers come before the ending."""
    name = path.name.removesuffix(ending)
    names = itertools.chain([path], (path.with_name(f"{name}-{number}{ending}") for number in itertools.count(2)))
    return next(name for name in names if not name.exists())


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write to a temporary file beside `path` and rename it. Raise UserError if there is no room or no permission."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink()
        if not isinstance(error, OSError):
            raise
        remedy = "free some space or choose another folder" if error.errno in FULL else "choose another folder"
        raise UserError(f"{path} cannot be written ({error.strerror}); {remedy}") from error


def try_lock(file: IO[bytes], *, shared: bool = False) -> bool:
    """Return whether this process got the lock of an open file, which it holds until the file is closed; always on a system
    without such locks."""
    try:
        import fcntl  # not on Windows
    except ImportError:
        return True
    try:
        fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True
