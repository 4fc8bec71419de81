"""What is kept in the workspace besides the documents that are edited: things are thrown away and restored, trees imported,
kits saved and opened, runs named."""

from __future__ import annotations

import dataclasses
import itertools
import re
import tempfile
from collections.abc import Collection, Mapping
from pathlib import Path
from types import MappingProxyType

from bt_jax._util.errors import UserError
from bt_jax._util.files import is_name, unused, write_atomic
from bt_jax.app.state.bus import Bus, Topic
from bt_jax.app.state.run_record import read_record
from bt_jax.app.state.trash import Trash, Trashable
from bt_jax.app.state.worker import Worker
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.files import check_tree, read_tree
from bt_jax.tasks import Task, task_names
from bt_jax.teaching.kit_file import KitFile, read_set, write_set
from bt_jax.training.run_note import RunNote, write_note

__all__ = ["LARGEST_TREE", "TREE_FILES", "Keeping", "Opened", "tree_of"]

TREE_FILES = (".txt", ".xml", ".json")
LARGEST_TREE = 1_000_000  # bytes
TOPICS: Mapping[Trashable, Topic] = MappingProxyType(
    {
        "run": "runs",
        "tree": "runs",
        "task": "task",
        "demonstrations": "demonstrations",
        "demonstration": "demonstrations",
    }
)


@dataclasses.dataclass(frozen=True)
class Opened:
    """What has come out of a kit, under the names that it has here."""

    task: str
    sets: tuple[str, ...]
    trees: tuple[str, ...]


class Keeping:
    """Works in a workspace and announces what has changed there."""

    def __init__(self, bus: Bus, worker: Worker, workspace: Workspace) -> None:
        self.trash = Trash(workspace)
        self._bus, self._worker, self._workspace = bus, worker, workspace

    async def put_away(self, kind: Trashable, name: str, of: str = "") -> None:
        """Move a thing into the trash. Raise UserError as `Trash.put` does."""
        await self._worker.work(self.trash.put, kind, name, of)
        self._bus.changed(TOPICS[kind], "trash")

    async def restore(self, id: str) -> str:
        """Take a thing out of the trash and return its name. Raise UserError as `Trash.restore` does."""
        kind, name = await self._worker.work(self.trash.restore, id)
        self._bus.changed(TOPICS[kind], "trash")
        return name

    async def empty(self) -> int:
        """Delete what is in the trash for good, and return how many things that were."""
        count = await self._worker.work(self.trash.empty)
        self._bus.changed("trash")
        return count

    async def note(self, run: str, note: RunNote) -> None:
        """Say something about a run. Raise UserError if it is too long, or the run has gone."""
        await self._worker.work(write_note, self._workspace.run(run).path, note)
        self._bus.changed("runs")

    async def import_tree(self, file: str, data: bytes, task: Task) -> str:
        """Keep the tree in a file of this name for a task, and return its name here. Raise UserError if it is no tree, or
        none of this task."""
        name = await self._worker.work(_imported, self._workspace, file, data, task)
        self._bus.changed("runs")
        return name

    async def save_kit(self, task: Task, sets: Collection[str], trees: Collection[str]) -> bytes:
        """Return the file of a kit: a task, sets of demonstrations, and the trees of runs and of other folders. Raise
        UserError if one of them has gone, is invalid or does not fit the task."""
        return await self._worker.work(_saved, self._workspace, task, tuple(sets), tuple(trees))

    async def open_kit(self, file: str, data: bytes) -> Opened:
        """Keep what is in a kit; what has the name of something else here gets a number. Raise UserError, and keep nothing,
        if it is none or cannot be trusted."""
        kit = await self._worker.work(KitFile.unpack, data, _shown(file))
        opened = await self._worker.work(_opened, self._workspace, kit)
        self._bus.changed("task", "runs", "demonstrations")
        return opened


def tree_of(workspace: Workspace, name: str) -> Tree:
    """Return the tree of a run, or of a folder that holds one. Raise UserError if there is none."""
    if name in workspace.learnt_names():
        return workspace.learnt_tree(name)
    tree = read_record(workspace.run(name)).tree
    if tree is None:
        raise UserError(f"{name} has no tree yet; let it evolve a generation")
    return tree


def _imported(workspace: Workspace, file: str, data: bytes, task: Task) -> str:
    shown, ending = _shown(file), Path(file).suffix.lower()
    if ending not in TREE_FILES:
        raise UserError(f"{shown} is no tree; choose a file whose name ends in {', '.join(TREE_FILES)}")
    if len(data) > LARGEST_TREE:
        raise UserError(f"{shown} is larger than {LARGEST_TREE // 1_000_000} MB; choose a file that holds one tree")
    with tempfile.TemporaryDirectory(prefix="bt_jax-") as scratch:
        source = Path(scratch) / f"tree{ending}"
        write_atomic(source, data)
        try:
            tree = read_tree(source)
            check_tree(tree, task, source)
        except UserError as error:
            raise UserError(str(error).replace(str(source), shown)) from error
    return workspace.add_tree(_name(Path(file).stem, "tree"), tree, task)


def _saved(workspace: Workspace, task: Task, sets: tuple[str, ...], trees: tuple[str, ...]) -> bytes:
    files = {name: read_set(workspace.demonstration_set(name)) for name in sets}
    return KitFile(task, files, {name: tree_of(workspace, name) for name in trees}).pack()


def _opened(workspace: Workspace, kit: KitFile) -> Opened:
    sets, trees = [], []
    task = _kept(workspace, kit.task)
    for name, files in kit.sets.items():
        folder = unused(workspace.demonstration_set(name).path)
        write_set(files, folder)
        sets.append(folder.name)
    for name, tree in kit.trees.items():
        trees.append(workspace.add_tree(name, tree, workspace.task(task)))
    return Opened(task, tuple(sets), tuple(trees))


def _kept(workspace: Workspace, task: Task) -> str:
    """Return the name of a task here, under which it is saved unless it is there already."""
    wanted = task.name[:56]  # so that there is room for a number
    for number in itertools.count(1):
        name = wanted if number == 1 else f"{wanted}-{number}"
        if name not in task_names() and workspace.filed(name) is None:
            workspace.save_task(name, task)
            break
        if workspace.holds(dataclasses.replace(task, name=name)):
            break
    return name


def _name(text: str, otherwise: str) -> str:
    """Return a name for a folder that is like a text."""
    name = re.sub(r"[^\w .+-]+", "-", text)[:80].strip(" .+-")
    return name if is_name(name) else otherwise


def _shown(file: str) -> str:
    """Return the name of a file as a sentence says it."""
    return _name(Path(file).name, "the file")
