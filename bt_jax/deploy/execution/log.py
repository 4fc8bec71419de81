"""The log of a run: one JSON object a line, written as it happens, so that a crash loses nothing.

`start` says what was run (tree and its digest, task, settings, versions), `tick` what was known and what each node
returned, `action` when an attempt began and how it ended, `motion` setpoints and feedback, `end` why it was over.
"""

from __future__ import annotations

import importlib.metadata
import json
import os
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from bt_jax._util.errors import UserError

__all__ = ["FORMAT", "Log", "read_log", "versions"]

FORMAT = 1
DIGITS = 5  # of joints in `motion`, rad


def versions() -> dict[str, str]:
    """Of everything that has a say in what the robot does; absent packages are left out."""
    found = {"python": platform.python_version()}
    for name in ("bt_jax", "mujoco", "numpy", "scipy", "pin", "opencv-python-headless", "protobuf"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


class Log:
    """Writes a log; without a path, nowhere. Use it as a context manager."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._file = None
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("x", encoding="utf-8")
        except FileExistsError as error:
            raise UserError(f"{path} exists already; choose another name for the log") from error
        except OSError as error:
            raise UserError(f"{path} cannot be written ({error.strerror}); choose another place for the log") from error

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, kind: str, **fields: Any) -> None:
        """Adds a line and hands it to the system at once."""
        if self._file is None:
            return
        self._file.write(json.dumps({"kind": kind, **fields}, allow_nan=False, default=_plain) + "\n")
        self._file.flush()

    def motion(self, arms: tuple[str, ...], records: np.ndarray, *, every: int) -> None:
        """Setpoints and feedback as `YumiLink.drain` gives them; of each arm every n-th cycle, by sequence number."""
        for index, arm in enumerate(arms):
            rows = records[records[:, 0] == index]
            rows = rows[rows[:, 16] % every == 0]
            if len(rows):
                self.write("motion", arm=arm, time=rows[:, 1].round(4).tolist(), **_joints(rows))

    def close(self) -> None:
        """Makes sure that everything is on the disk."""
        if self._file is not None and not self._file.closed:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()


def read_log(path: Path) -> Iterator[dict[str, Any]]:
    """The lines of a log in order; a last one that was not finished is left out.

    Raises UserError where it is no log of this version.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path} cannot be read ({error}); give the log that a run has written") from error
    for number, line in enumerate(lines, start=1):
        try:
            entry = json.loads(line)
            kind = entry["kind"]
        except (ValueError, KeyError, TypeError) as error:
            if number == len(lines) and number > 1:
                return
            raise UserError(
                f"{path}, line {number} is not part of a log; give the log that a run has written"
            ) from error
        if number == 1 and (kind != "start" or entry.get("format") != FORMAT):
            raise UserError(f"{path} is no log of format {FORMAT}; use the version of bt_jax that wrote it")
        yield entry
    if not lines:
        raise UserError(f"{path} is empty; give the log that a run has written")


def _joints(rows: np.ndarray) -> dict[str, list]:
    return {"setpoint": _numbers(rows[:, 2:9]), "measured": _numbers(rows[:, 9:16])}


def _numbers(rows: np.ndarray) -> list:
    """As JSON has them: null where a measurement is not a number."""
    rounded = rows.round(DIGITS)
    return np.where(np.isfinite(rounded), rounded.astype(object), None).tolist()


def _plain(value: Any) -> Any:
    """What JSON does not know by itself."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)
