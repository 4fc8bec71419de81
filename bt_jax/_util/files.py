"""Writing files so that a reader never meets half of one."""

from __future__ import annotations

import itertools
import os
import re
import tempfile
from pathlib import Path

from bt_jax._util.errors import UserError

__all__ = ["is_name", "unused", "write_atomic"]


def is_name(text: str) -> bool:
    """Whether a text can name a file or folder that a person has chosen a name for: in one folder, visible, harmless."""
    return re.fullmatch(r"\w[\w .+-]{0,99}", text) is not None


def unused(path: Path) -> Path:
    """The path, or with -2, -3, ... behind it the first that nothing has yet."""
    names = itertools.chain([path], (path.with_name(f"{path.name}-{number}") for number in itertools.count(2)))
    return next(name for name in names if not name.exists())


def write_atomic(path: Path, content: str | bytes) -> None:
    """Writes to a temporary file beside `path` and renames it. Raises UserError where there is no room or no right to."""
    data = content.encode("utf-8") if isinstance(content, str) else content
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, prefix=f".{path.name}.", delete=False) as file:
            temporary = file.name
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException as error:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)
        if not isinstance(error, OSError):
            raise
        raise UserError(
            f"{path} cannot be written ({error.strerror}); free some space or choose another folder"
        ) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
