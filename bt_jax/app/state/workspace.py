"""The folder that the page works in: its runs, demonstrations and tasks, and the drafts of the task that is edited and
of the demonstration in the making.

Names come from the browser. Each is checked here, so that none leads out of the folder.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import itertools
import re
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax._util.files import NAME_RULE, is_name, unused, write_atomic
from bt_jax._util.text_files import decode_text
from bt_jax._util.yaml_files import to_yaml
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.files import read_tree
from bt_jax.encoding.formats.text import format_tree
from bt_jax.lfd import DemonstrationFolder
from bt_jax.tasks import Task, load_task, parse_task, task_names, task_of_folder
from bt_jax.training.run_folder import RunFolder

__all__ = ["Workspace"]

LEARNT = "learnt_tree.txt"


@dataclasses.dataclass(frozen=True)
class Workspace:
    """`root/runs`, `root/demonstrations`, `root/tasks`, `root/logs`, the drafts `root/draft.yaml` and
    `root/demonstration_draft.json`, and files for trainings in `root/.inputs`."""

    root: Path

    @property
    def runs(self) -> Path:
        return self.root / "runs"

    @property
    def demonstrations(self) -> Path:
        return self.root / "demonstrations"

    @property
    def tasks(self) -> Path:
        return self.root / "tasks"

    @property
    def logs(self) -> Path:
        """Where runs on the robot's twin are logged."""
        return self.root / "logs"

    @property
    def inputs(self) -> Path:
        """Where files for trainings are written, which may read them after the page was closed."""
        return self.root / ".inputs"

    @property
    def is_empty(self) -> bool:
        """Whether nothing was kept here yet."""
        return not (self._draft.is_file() or self._demonstration.is_file()) and not any(
            folder.is_dir() and any(folder.iterdir()) for folder in (self.runs, self.tasks, self.demonstrations)
        )

    def run_names(self) -> list[str]:
        """Return the names of the run folders, the newest first."""
        found = [path for path in _folders(self.runs) if (path / "config.json").is_file()]
        return [path.name for path in sorted(found, key=_changed, reverse=True)]

    def run(self, name: str) -> RunFolder:
        """Return an existing run folder. Raise UserError if it has gone, or the name leads out of the workspace."""
        path = self.inside(self.runs, name)
        if not (path / "config.json").is_file():
            raise UserError(f"the run {name} is no longer there; choose another, or evolve again")
        return RunFolder(path)

    def learnt_names(self) -> list[str]:
        """Return the folders with trees of no run that `bt_jax.learn` and imports have left among the runs, the newest
        first."""
        found = [path for path in _folders(self.runs) if (path / LEARNT).is_file()]
        return [path.name for path in sorted(found, key=lambda path: (path / LEARNT).stat().st_mtime, reverse=True)]

    def learnt_tree(self, name: str) -> Tree:
        """Return the tree in such a folder. Raise UserError if it has gone or cannot be read."""
        return read_tree(self.inside(self.runs, name) / LEARNT)

    def learnt_task(self, name: str) -> Task | None:
        """Return the task of the tree in such a folder, None if it does not say. Raise UserError if it cannot be read."""
        return task_of_folder(self.inside(self.runs, name))

    def add_tree(self, name: str, tree: Tree, task: Task) -> str:
        """Keep a tree of a task in such a folder, and return its name, which has a number if there is another of it. Raise
        UserError if the name is none, or nothing can be written."""
        folder = unused(self.inside(self.runs, name))
        write_atomic(folder / "task.yaml", to_yaml(task.to_dict()))
        write_atomic(folder / LEARNT, format_tree(tree))  # last: from now on it is listed
        return folder.name

    def log_names(self) -> list[str]:
        """Return the names of the logs, the newest first."""
        found = [path for path in self.logs.glob("*.jsonl") if is_name(path.stem)] if self.logs.is_dir() else []
        return [path.stem for path in sorted(found, key=lambda path: (path.stat().st_mtime, path.name), reverse=True)]

    def log(self, name: str) -> Path:
        """Return the file of a log. Raise UserError if it has gone or the name leads out of the workspace."""
        self.inside(self.logs, name)
        path = self.inside(self.logs, f"{name}.jsonl")
        if not path.is_file():
            raise UserError(f"the log {name} is no longer there; choose another")
        return path

    def demonstration_sets(self) -> list[str]:
        """Return the names of the sets of demonstrations."""
        return sorted(path.name for path in _folders(self.demonstrations) if (path / "info.yaml").is_file())

    def demonstration_set(self, name: str) -> DemonstrationFolder:
        """Return a set of demonstrations, which may not exist yet. Raise UserError if its name leads out of the folder."""
        return DemonstrationFolder(self.inside(self.demonstrations, name))

    def task_names(self) -> list[str]:
        """Return the names of the tasks of the package, then of those saved here."""
        own = sorted(path.stem for path in self.tasks.glob("*.yaml")) if self.tasks.is_dir() else []
        return [*task_names(), *(name for name in own if name not in task_names())]

    def task(self, name: str) -> Task:
        """Return a task by its name. Raise UserError if the file is invalid, gone or outside the workspace."""
        if name in task_names():
            return load_task(name)
        return load_task(self.inside(self.tasks, f"{name}.yaml"), unfinished=True)

    def imported(self, file: str, content: bytes) -> Task:
        """Return the task in a file that was sent, by a name that no task here has yet. Raise UserError if it is invalid."""
        task = parse_task(decode_text(content, file), source=file, unfinished=True)
        names = itertools.chain([task.name], (f"{task.name}_{n}" for n in itertools.count(2)))
        return dataclasses.replace(task, name=next(name for name in names if name not in self.task_names()))

    def save_task(self, name: str, task: Task) -> Path:
        """Write a task file. Raise UserError if the name is that of a task of the package, or no name for a file."""
        if not re.fullmatch(r"[\w-]{1,64}", name):
            raise UserError(f"'{name}' cannot name a task; use letters, digits, _ and -; at most 64")
        if name in task_names():
            raise UserError(f"the task {name} comes with the package and stays as it is; choose another name")
        path = self.inside(self.tasks, f"{name}.yaml")
        write_atomic(path, to_yaml(dataclasses.replace(task, name=name).to_dict()))
        return path

    def own_task_names(self) -> list[str]:
        """Return the names of the tasks that were saved here."""
        return [name for name in self.task_names() if name not in task_names()]

    def filed(self, name: str) -> bytes | None:
        """Return the file of a task that was saved here, None if there is none."""
        with contextlib.suppress(UserError, OSError):
            return self.inside(self.tasks, f"{name}.yaml").read_bytes()
        return None

    def holds(self, task: Task) -> bool:
        """Whether the file of the task's name says exactly this. It is read only if a task file has changed."""
        own = [] if task.name in task_names() else sorted(self.tasks.glob("*.yaml"))  # one may extend another
        with contextlib.suppress(UserError, OSError):
            return _task(self, task.name, tuple(map(_stamp, own))) == task
        return False

    def run_holds(self, name: str, task: Task) -> bool:
        """Whether a run works for exactly this task. Its configuration is read only if it has changed."""
        with contextlib.suppress(UserError, OSError):
            return _task_of_run(self, name, _stamp(self.run(name).path / "config.json")) == task
        return False

    def draft(self) -> Task | None:
        """Return the draft of a task, None if there is none. Raise UserError if it is invalid."""
        return load_task(self._draft, unfinished=True) if self._draft.is_file() else None

    def save_draft(self, task: Task) -> None:
        """Replace the draft."""
        write_atomic(self._draft, to_yaml(task.to_dict()))

    def delete_draft(self) -> None:
        """Delete the draft, if there is one. Raise UserError if that fails."""
        self._delete(self._draft)

    def set_draft_aside(self) -> Path:
        """Rename a draft that cannot be read, so that the next one does not replace it, and return its path. Raise UserError
        if that fails."""
        return _set_aside(self._draft, before="you change the task")

    def demonstration_draft(self) -> str | None:
        """Return the draft of a demonstration, None if there is none. Raise UserError if it cannot be read."""
        try:
            return self._demonstration.read_text(encoding="utf-8") if self._demonstration.is_file() else None
        except (OSError, UnicodeDecodeError) as error:
            raise UserError(f"it cannot be read ({error}); demonstrate it again") from error

    def keep_demonstration_draft(self, text: str | None) -> None:
        """Replace the draft of a demonstration, or delete it. Raise UserError if that fails."""
        if text is not None:
            write_atomic(self._demonstration, text)
        else:
            self._delete(self._demonstration)

    def set_demonstration_draft_aside(self) -> Path:
        """Rename a draft of a demonstration that cannot be restored, and return its path. Raise UserError if that fails."""
        return _set_aside(self._demonstration, before="you demonstrate")

    def _delete(self, file: Path) -> None:
        """Delete a file, if it is there. Raise UserError if that fails."""
        try:
            file.unlink(missing_ok=True)
        except OSError as error:
            raise UserError(
                f"{file} cannot be deleted ({error.strerror}); check the permissions of {self.root}"
            ) from None

    @property
    def _draft(self) -> Path:
        return self.root / "draft.yaml"

    @property
    def _demonstration(self) -> Path:
        return self.root / "demonstration_draft.json"

    def inside(self, folder: Path, name: str) -> Path:
        """Return the path of a name in a folder of the workspace. Raise UserError if it would lead out of it."""
        path = folder / name
        if not is_name(name):
            raise UserError(f"'{name}' cannot name anything here; use {NAME_RULE}")
        if path.resolve().parent != folder.resolve():
            raise UserError(f"'{name}' leads out of {self.root}; choose a name from the list")
        return path


def _set_aside(draft: Path, *, before: str) -> Path:
    aside = unused(draft.with_name(f"{draft.name}.unreadable"))
    try:
        draft.rename(aside)
    except OSError as error:
        raise UserError(f"{draft} cannot be renamed ({error.strerror}); copy it before {before}") from None
    return aside


Stamp = tuple[Path, int, int, int]


def _stamp(path: Path) -> Stamp:
    """Return what differs once a file has been written again. Raise OSError if there is no such file."""
    found = path.stat()
    return path, found.st_mtime_ns, found.st_ino, found.st_size


@functools.lru_cache(maxsize=16)
def _task(workspace: Workspace, name: str, stamps: tuple[Stamp, ...]) -> Task:
    return workspace.task(name)


@functools.lru_cache(maxsize=16)
def _task_of_run(workspace: Workspace, name: str, stamp: Stamp) -> Task:
    return workspace.run(name).config().task


def _folders(folder: Path) -> list[Path]:
    """Return the folders in a folder, without links."""
    if not folder.is_dir():
        return []
    return [path for path in folder.iterdir() if path.is_dir() and not path.is_symlink() and is_name(path.name)]


def _changed(run: Path) -> float:
    try:
        return (run / "config.json").stat().st_mtime
    except OSError:
        return 0.0
