"""What the experiment has found so far, as a file with which it goes on."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.json_files import read_json

__all__ = ["Records"]


@dataclasses.dataclass
class Records:
    """Trees by task, model and seed, and for each distinct tree the episodes that it solves, as bits in hexadecimal digits,
    by task and condition."""

    settings: dict[str, str]  # of the arguments all that changes what is found
    trees: dict[str, str] = dataclasses.field(default_factory=dict)
    seconds: dict[str, float] = dataclasses.field(default_factory=dict)
    tests: dict[str, str] = dataclasses.field(default_factory=dict)

    @staticmethod
    def begun(source: Path, settings: dict[str, str]) -> Records:
        """Return the records in a file, or new ones. Raise UserError if they are of other settings."""
        if not source.exists():
            return Records(settings)
        found = decode(read_json(source), Records, source)
        if different := [name for name, value in settings.items() if found.settings.get(name) != value]:
            name, now = different[0], settings[different[0]]
            raise UserError(
                f"{source} was begun with {name} {found.settings.get(name)} and now it is {now}; choose another --out"
            )
        return found

    def save(self, path: Path) -> None:
        """Replace the file."""
        write_atomic(path, json.dumps(dataclasses.asdict(self), indent=1) + "\n")

    def note(self, key: str, solved: Bool[np.ndarray, " K"]) -> None:
        """Keep which episodes a tree solves."""
        self.tests[key] = np.packbits(solved).tobytes().hex()

    def solved(self, key: str, episodes: int) -> Bool[np.ndarray, " K"]:
        """Return which episodes a tree solves."""
        return np.unpackbits(np.frombuffer(bytes.fromhex(self.tests[key]), np.uint8))[:episodes].astype(bool)
