"""The tree that a person corrects by hand: a document with a history, tried in many starts after every change."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from bt_jax._util.errors import UserError
from bt_jax.app.processes.train_command import Beginning
from bt_jax.app.processes.tree_trial import TreeTrial, Tried
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.edited_task import EditedTask
from bt_jax.app.state.edited_tree import Edited, Part, Path
from bt_jax.app.state.history import History
from bt_jax.app.state.playing import Playing
from bt_jax.behaviors import Tree, check_names, gene_pool
from bt_jax.encoding.walk import leaves, tidy
from bt_jax.tasks import Task

__all__ = ["Correction"]


class Correction:
    """`selected` is the node that the next change is about, `tried` how often the tree works as far as that is known, and
    `problem` why it could not be tried. Changes are announced as "correction"."""

    def __init__(self, bus: Bus, edited: EditedTask, playing: Playing) -> None:
        self.tried: Tried | None = None
        self.problem = ""
        self._bus, self._edited, self._playing = bus, edited, playing
        self._history: History[Edited] | None = None
        self._trial = TreeTrial()
        self._trying: asyncio.Task[None] | None = None

    @property
    def part(self) -> Part | None:
        """The tree as it is edited, None if none is."""
        return None if self._history is None else self._history.present.part

    @property
    def selected(self) -> Path:
        return () if self._history is None else self._history.present.path

    @property
    def can_undo(self) -> bool:
        return self._history is not None and bool(self._history.past)

    @property
    def can_redo(self) -> bool:
        return self._history is not None and bool(self._history.future)

    @property
    def tree(self) -> Tree | None:
        """What runs: the tree without what is switched off."""
        working = None if self.part is None else self.part.working
        return None if working is None else working.tree

    def begin(self, tree: Tree) -> None:
        """Edit a tree; what was edited before is forgotten."""
        self._history = History(Edited(Part.of(tree), ()))
        self._changed()

    def end(self) -> None:
        """Edit nothing any more; the tree stays the one that is looked at."""
        self._stop_trying()
        self._history, self.tried = None, None
        self._bus.changed("correction")

    def edit(self, change: Callable[[Part, Path], Edited]) -> None:
        """Change the tree, at the node that is selected. Raise UserError, and change nothing, if that is not possible."""
        if self._history is None:
            raise UserError("no tree is edited; press Correct by hand first")
        edited = change(self._history.present.part, self.selected)
        for leaf in leaves(edited.part.tree):
            check_names(leaf, self._edited.task)
        self._history = self._history.changed(edited)
        self._changed()

    def select(self, path: Path) -> None:
        """Choose the node that the next change is about."""
        if self._history is not None:
            present = Edited(self._history.present.part, path)
            self._history = History(present, self._history.past, self._history.future)
            self._bus.changed("correction")

    def undo(self) -> None:
        """Take back the last change. Raise UserError if there is none."""
        if self._history is not None:
            self._history = self._history.undone()
            self._changed()

    def redo(self) -> None:
        """Repeat the change that was taken back last. Raise UserError if there is none."""
        if self._history is not None:
            self._history = self._history.redone()
            self._changed()

    def beginning(self, task: Task) -> Beginning:
        """Return where evolution goes on: at the tree, without the leaves that stand only where it is switched off."""
        tree, part = self.tree, self.part
        baseline = None if tree is None else tidy(tree)
        if part is None or baseline is None:
            raise UserError("no tree is edited; press Correct by hand first")
        pool = gene_pool(task).leaves
        return Beginning(baseline, tuple(leaf for leaf in part.unused if leaf in pool))

    def try_again(self) -> None:
        """Try the tree in the task as it is now."""
        if self._history is not None:
            self._try()

    def close(self) -> None:
        """End the process that tries."""
        self._stop_trying()
        self._trial.close()

    def _changed(self) -> None:
        self._playing.take(self.tree, None)
        self._try()
        self._bus.changed("correction", "tree", "player")

    def _try(self) -> None:
        self._stop_trying()
        self.tried, self.problem = None, ""
        if self.tree is not None:
            self._trying = asyncio.get_running_loop().create_task(self._go_on_trying(self._edited.task, self.tree))

    def _stop_trying(self) -> None:
        if self._trying is not None:
            self._trying.cancel()
        self._trying = None

    async def _go_on_trying(self, task: Task, tree: Tree) -> None:
        try:
            async with contextlib.aclosing(self._trial.tried(task, tree)) as results:
                async for self.tried in results:
                    self._bus.changed("correction")
        except UserError as error:
            self.problem = str(error)
            self._bus.changed("correction")
