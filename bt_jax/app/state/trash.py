"""What was deleted on the page lies in the folder `trash` of the workspace until it is restored or the trash is emptied.

Each deleted thing is a folder `trash/DATE-TIME-NAME` with `entry.json`, which says what it is and where it was, and with the
thing itself under its own name.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import unused, write_atomic
from bt_jax._util.json_files import read_json
from bt_jax.app.state.workspace import Workspace
from bt_jax.tasks import task_names
from bt_jax.training.progress import is_alive

__all__ = ["KINDS", "Trash", "Trashable", "Trashed"]

Trashable = Literal["run", "tree", "task", "demonstrations", "demonstration"]
KINDS: Mapping[Trashable, str] = MappingProxyType(
    {
        "run": "run",
        "tree": "tree",
        "task": "task",
        "demonstrations": "set of demonstrations",
        "demonstration": "demonstration",
    }
)


@dataclasses.dataclass(frozen=True)
class Trashed:
    """A thing in the trash: `id` names its folder there, `set` is the set that a demonstration was in."""

    id: str
    kind: Trashable
    name: str
    when: datetime
    set: str = ""


@dataclasses.dataclass(frozen=True)
class _Entry:
    """What `entry.json` holds."""

    kind: Trashable
    name: str
    when: str
    set: str = ""


@dataclasses.dataclass(frozen=True)
class Trash:
    """The trash of a workspace."""

    workspace: Workspace

    @property
    def path(self) -> Path:
        return self.workspace.root / "trash"

    def put(self, kind: Trashable, name: str, of: str = "") -> Trashed:
        """Move a thing here; `of` is the set that a demonstration is in. Raise UserError, and move nothing, if it has gone,
        its name leads out of the workspace, or it is in use."""
        source = self._place(kind, name, of)
        if not source.exists():
            raise UserError(f"the {KINDS[kind]} {name} is no longer there; choose another")
        if kind == "run" and is_alive(source):
            raise UserError(f"{name} is evolving; stop it before you delete it")
        now = datetime.now()
        folder = unused(self.path / f"{now:%Y%m%d-%H%M%S}-{name[:80]}")
        write_atomic(folder / "entry.json", json.dumps(dataclasses.asdict(_Entry(kind, name, now.isoformat(), of))))
        try:
            source.rename(folder / source.name)
        except OSError as error:
            shutil.rmtree(folder, ignore_errors=True)
            raise UserError(f"{name} cannot be deleted ({error.strerror}); check the permissions of {source}") from None
        return Trashed(folder.name, kind, name, now, of)

    def entries(self) -> list[Trashed]:
        """Return what lies here, what was deleted last first; folders that say nothing are left out."""
        found = []
        for folder in self.path.iterdir() if self.path.is_dir() else ():
            with contextlib.suppress(UserError):
                found.append(self._read(folder.name))
        return sorted(found, key=lambda one: (one.when, one.id), reverse=True)

    def restore(self, id: str) -> tuple[Trashable, str]:
        """Move a thing back to where it was, and return what it is and its name, which has a number if another thing has it
        by now. Raise UserError if it has gone, or the set of a demonstration has."""
        entry = self._read(id)
        place = self._place(entry.kind, entry.name, entry.set)
        if entry.kind == "demonstration" and not place.parent.is_dir():
            raise UserError(f"the set {entry.set} of {entry.name} is not there; restore it first")
        folder, new = self.path / id, unused(place, ending=".yaml" if entry.kind == "task" else "")
        try:
            new.parent.mkdir(parents=True, exist_ok=True)
            (folder / place.name).rename(new)
        except OSError as error:
            raise UserError(f"{entry.name} cannot be restored ({error.strerror}); look at {folder}") from None
        shutil.rmtree(folder, ignore_errors=True)
        return entry.kind, new.stem if entry.kind == "task" else new.name

    def empty(self) -> int:
        """Delete everything here for good, and return how many things that were. Raise UserError if that fails."""
        count = len(self.entries())
        try:
            if self.path.is_dir():
                shutil.rmtree(self.path)
        except OSError as error:
            raise UserError(
                f"the trash cannot be emptied ({error.strerror}); check the permissions of {self.path}"
            ) from None
        return count

    def _read(self, id: str) -> Trashed:
        """Return what a folder in the trash is. Raise UserError if it has gone or says nothing that can be true."""
        folder = self.workspace.inside(self.path, id)
        if not (folder / "entry.json").is_file():
            raise UserError(f"{id} is no longer in the trash; look at what is")
        entry = decode(read_json(folder / "entry.json"), _Entry, folder / "entry.json")
        thing = folder / self._place(entry.kind, entry.name, entry.set).name
        if not thing.exists() or thing.is_symlink():
            raise UserError(f"{entry.name} is no longer in the trash; look at what is")
        try:
            when = datetime.fromisoformat(entry.when)
        except ValueError:
            raise UserError(f"{folder / 'entry.json'}, key when: no time; delete the folder") from None
        return Trashed(id, entry.kind, entry.name, when, entry.set)

    def _place(self, kind: Trashable, name: str, of: str) -> Path:
        """Return where a thing of a kind lies. Raise UserError if that is not in the workspace."""
        workspace = self.workspace
        if kind == "task":
            if name in task_names():
                raise UserError(f"the task {name} comes with the package and stays")
            return workspace.inside(workspace.tasks, f"{name}.yaml")
        if kind == "demonstration":
            return workspace.inside(workspace.demonstration_set(of).path, name)
        return workspace.inside(workspace.demonstrations if kind == "demonstrations" else workspace.runs, name)
