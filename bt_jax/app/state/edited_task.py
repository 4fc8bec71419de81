"""The task that a person edits: a document with a history. It is not the task that an evolution works for.

Every version is immutable and holds the task and the layout in which the scene starts.
"""

from __future__ import annotations

import asyncio
import dataclasses

from bt_jax.app.state.history import History
from bt_jax.app.state.kit.starting import first_start
from bt_jax.app.state.workspace import Workspace
from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["EditedTask", "same_goal", "same_places", "same_things"]


@dataclasses.dataclass(frozen=True, eq=False)
class _Version:
    """A task and the layout in which the scene starts, a batch of one state (NumPy)."""

    task: Task
    start: World


class EditedTask:
    """The task in step 1. `turn` is held while an edit is computed from the task before it, so that none is lost."""

    def __init__(self, workspace: Workspace, task: Task) -> None:
        self.turn = asyncio.Lock()
        self._workspace = workspace
        self._history = History(_Version(task, first_start(task)))
        self._filed = workspace.filed(task.name)  # what the file said when the task was opened or saved last

    @property
    def task(self) -> Task:
        return self._history.present.task

    @property
    def start(self) -> World:
        """The layout in which the scene starts, a batch of one state (NumPy)."""
        return self._history.present.start

    @property
    def can_undo(self) -> bool:
        return bool(self._history.past)

    @property
    def can_redo(self) -> bool:
        return bool(self._history.future)

    @property
    def changed_on_disk(self) -> bool:
        """Whether the file of the task's name says something else than when the task was opened or saved last."""
        now = self._workspace.filed(self.task.name)
        return now is not None and now != self._filed

    @property
    def saved(self) -> bool:
        """Whether the task equals its file."""
        return self._workspace.holds(self.task)

    def open(self, task: Task, start: World | None = None) -> None:
        """Take another task, with a new history; it starts in the first layout that is drawn unless `start` is given."""
        self._history = History(_version(task, first_start(task) if start is None else start))
        self._filed = self._workspace.filed(task.name)

    def save(self, name: str) -> None:
        """Write the task to the file of a name, which is its name from now on. Raise UserError as `Workspace.save_task`."""
        self._workspace.save_task(name, self.task)
        self.edit(self._workspace.task(name))
        self._filed = self._workspace.filed(name)

    def edit(self, task: Task, start: World | None = None) -> None:
        """Change the task. It starts as before unless `start` is given, which a task with other objects or kits needs."""
        self._history = self._history.changed(_version(task, self.start if start is None else start))

    def undo(self) -> None:
        """Take back the last edit. Raise UserError if there is none."""
        self._history = self._history.undone()

    def redo(self) -> None:
        """Repeat the edit that was taken back last. Raise UserError if there is none."""
        self._history = self._history.redone()


def same_things(one: Task, other: Task) -> bool:
    """Whether two tasks have the same objects and frames, so that a tree of one can run in the other."""
    return (one.objects, one.frames) == (other.objects, other.frames)


def same_goal(one: Task, other: Task) -> bool:
    """Whether two tasks say the same, whatever their names and descriptions are and in whatever order their targets
    stand."""
    return _goal(one) == _goal(other)


def same_places(one: Task, other: Task) -> bool:
    """Whether two tasks have the same things, the same targets and the same starts: what an evolution can take over from
    another task when it goes on."""
    return same_things(one, other) and one.layout == other.layout and set(one.targets) == set(other.targets)


def _goal(task: Task) -> Task:
    targets = tuple(sorted(task.targets, key=lambda target: (target.object, target.frame, target.position)))
    return dataclasses.replace(task, name="", description="", targets=targets)


def _version(task: Task, start: World) -> _Version:
    return _Version(task, dataclasses.replace(start, reached=subgoals_by_sight(task, start)))
