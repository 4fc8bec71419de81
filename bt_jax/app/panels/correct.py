"""The tools with which a person corrects the tree of step 6 by hand; every change is tried in many starts."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from datetime import datetime
from typing import Any, cast

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.context import PanelContext
from bt_jax.app.panels.parts import button
from bt_jax.app.plain_words import Words
from bt_jax.app.state import edited_tree
from bt_jax.app.state.edited_tree import Direction, Edited, Part, Path, Where, at, paths
from bt_jax.app.state.finding import starting_at
from bt_jax.app.state.player import Player
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Behavior, Kind, gene_pool
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["Correct"]

AROUND: dict[str, Kind | tuple[str, int | None]] = {
    "all": Kind.SEQUENCE,
    "one": Kind.FALLBACK,
    "retry 3": ("retry", 3),
    "retry 10": ("retry", 10),
    "timeout 5": ("timeout", 5),
    "timeout 20": ("timeout", 20),
}
DIRECTIONS: dict[str, Direction] = {
    "ArrowLeft": "earlier",
    "ArrowRight": "later",
    "ArrowUp": "out",
    "ArrowDown": "in",
}
HELP = (
    "Click a node, or reach it with the arrow keys. Drag it before, into or after another; with the keyboard, Alt and the "
    "arrow keys move it, and Delete deletes it."
)


class Correct:
    """The row above the tree, and the editor of the tree (`widgets.tree_view.Editor`)."""

    def __init__(self, studio: Studio, page: PanelContext) -> None:
        self.studio, self.page = studio, page
        self._guard = functools.partial(page.guard, steers="run")
        self.select, self.key, self.move = (self._guard(each) for each in (self._select, self._key, self._move))
        with ui.row().classes("items-center gap-2 w-full"):
            self.begin = button("Correct by hand", "correct-begin", "edit", self._guard(self._begin))
            self.tried = ui.label().classes("correct-tried").props("data-testid=correct-tried role=status")
            self.reasons = ui.label().classes("hint").props("data-testid=correct-reasons")
        with ui.column().classes("gap-1 w-full").props("data-testid=correct-tools") as self.tools:
            with ui.row().classes("items-center gap-1"):
                change = self._changing
                self.undo = self._tool("undo", "Undo", "undo", lambda: studio.correction.undo())
                self.undo.props("data-undo")
                self.redo = self._tool("redo", "Redo", "redo", lambda: studio.correction.redo())
                self.redo.props("data-redo")
                self.delete = self._tool("delete", "Delete", "delete", change(edited_tree.delete))
                self.switch = self._tool("off", "Switch off", "toggle_off", change(edited_tree.switch))
                self.lock = self._tool("lock", "Lock: evolution leaves it whole", "lock", change(edited_tree.lock))
                around = ui.select({}, label="Put around it")
                self.around = around.on("update:model-value", self._guard(self._wrap))
                around.props("dense outlined options-dense data-testid=correct-around").classes("correct-around")
                self.keep = button("Keep", "correct-keep", "save", self._guard(self._keep))
                self.evolve = button("Evolve from it", "correct-evolve", "auto_graph", self._guard(self._evolve))
            with ui.row().classes("items-center gap-1 w-full no-wrap"):
                self.palette = ui.select({}, label="Something to insert", with_input=True)
                self.palette.props("dense outlined options-dense data-testid=correct-palette").classes("run-source")
                for where, text in (("before", "Before"), ("inside", "Inside"), ("after", "After")):
                    insert = functools.partial(self._insert, cast(Where, where))
                    button(text, f"correct-{where}", "add", self._guard(insert), more="outline")
            ui.label(HELP).classes("hint")

    def show(self, tree: TreeView) -> None:
        """Show the tree that is edited, what can be done with the selected node, and how often the tree works."""
        correction, task = self.studio.correction, self.studio.edited.task
        part = correction.part
        self.tools.set_visibility(part is not None)
        self.begin.set_text("Correct by hand" if part is None else "Done")
        self.begin.set_enabled(part is not None or self.studio.playing.tree is not None)
        tried = correction.tried
        waiting = "being tried in 100 starts" if part is not None else ""
        self.tried.set_text(correction.problem or (tried.sentence if tried is not None else waiting))
        self.reasons.set_text("; ".join(tried.reasons) if tried is not None else "")
        if part is None:
            tree.look()
            return
        tree.show(part.tree, task, whole=True)
        tree.edit(paths(part).index(correction.selected), part.off_at)
        chosen = at(part, correction.selected)
        self.undo.set_enabled(correction.can_undo)
        self.redo.set_enabled(correction.can_redo)
        self.delete.set_enabled(bool(correction.selected))
        _named(self.switch, "Switch on" if chosen.off else "Switch off", "toggle_on" if chosen.off else "toggle_off")
        locked = isinstance(chosen.head, Behavior) and chosen.head.body is not None
        self.lock.set_enabled(locked or bool(chosen.children))
        _named(self.lock, "Unlock" if locked else "Lock: evolution leaves it whole", "lock_open" if locked else "lock")
        self._fill(task)

    def statuses(self, player: Player) -> dict[str, Status | None]:
        """Return what the nodes returned by their ids in the drawing, where those that are switched off have ids, too."""
        part = self.studio.correction.part
        if part is None:
            return player.statuses
        drawn = part.works_at
        found: dict[str, Status | None] = {}
        for name, status in player.statuses.items():
            _, number, *inside = name.split("-")
            found["-".join(["node", str(drawn[int(number)]), *inside])] = status
        return found

    def _fill(self, task: Task) -> None:
        """Offer what can be inserted in a task."""
        words = Words(task)
        palette = {str(leaf): words(leaf) for leaf in _palette(task, self.studio)}
        if self.palette.options != palette:
            self.palette.set_options(palette, value=self.palette.value if self.palette.value in palette else None)
        leaf = Part(Behavior("open_gripper"))
        around = {name: words(Part(head, (leaf,)).tree) for name, head in AROUND.items()}
        if self.around.options != around:
            self.around.set_options(around, value=None)

    def _begin(self) -> None:
        if self.studio.correction.part is not None:
            self.studio.correction.end()
            return
        tree = self.studio.playing.tree
        if tree is None:
            raise UserError("there is no tree to correct yet; find one in step 2, or choose one")
        self.studio.correction.begin(tree)

    def _select(self, number: int) -> None:
        part = self.studio.correction.part
        if part is not None and number < part.size:
            self.studio.correction.select(paths(part)[number])

    def _key(self, key: str, *, alt: bool) -> None:
        correction = self.studio.correction
        if correction.part is None:
            return
        if key == "Delete":
            correction.edit(edited_tree.delete)
        elif alt:
            correction.edit(lambda part, path: edited_tree.nudge(part, path, DIRECTIONS[key]))
        else:
            correction.select(_beside(correction.part, correction.selected, key))

    def _move(self, number: int, to: int, where: Where) -> None:
        def moved(part: Part, path: Path) -> Edited:
            places = paths(part)
            return edited_tree.move(part, places[number], places[to], where)

        self.studio.correction.edit(moved)

    def _insert(self, where: Where) -> None:
        if self.palette.value is None:
            raise UserError("nothing is chosen yet; choose something to insert first")
        leaf = next(leaf for leaf in _palette(self.studio.edited.task, self.studio) if str(leaf) == self.palette.value)
        self.studio.correction.edit(lambda part, path: edited_tree.insert(part, path, Part(leaf), where))

    def _wrap(self) -> None:
        head = AROUND.get(self.around.value)
        self.around.set_value(None)
        if head is not None:
            self.studio.correction.edit(lambda part, path: edited_tree.wrap(part, path, head))

    def _changing(self, change: Callable[[Part, Path], Edited]) -> Callable[[], None]:
        return lambda: self.studio.correction.edit(change)

    def _keep(self) -> None:
        studio, tree = self.studio, self.studio.correction.tree
        if tree is None:
            raise UserError("no tree is edited; press Correct by hand first")
        task = studio.edited.task
        name = studio.workspace.add_tree(f"{task.name}-by-hand-{datetime.now():%Y%m%d-%H%M%S}", tree, task)
        studio.bus.changed("runs")
        self.page.say(f"The tree is kept as {name}.", "success")

    def _evolve(self) -> None:
        """Evolve from the tree, without what stands only where it is switched off."""
        studio = self.studio
        begin = studio.correction.beginning(studio.edited.task)
        assert begin.baseline is not None
        gp = starting_at(begin.baseline, dataclasses.replace(studio.evolution.gp, gene_under_fallback=False))
        studio.start_evolution(gp, begin)
        studio.correction.end()
        self.page.go("evolve")

    def _tool(self, name: str, hint: str, icon: str, handler: Callable[[], Any]) -> ui.button:
        made = button("", f"correct-{name}", icon, self._guard(handler), more="flat")
        with made:
            ui.tooltip()
        _named(made, hint, icon)
        return made


def _named(made: ui.button, hint: str, icon: str) -> None:
    made.set_icon(icon)
    made.props["aria-label"] = hint
    made.update()
    for tooltip in made.descendants():
        if isinstance(tooltip, ui.tooltip):
            tooltip.set_text(hint)


def _palette(task: Task, studio: Studio) -> list[Behavior]:
    """Return what can be inserted: what evolution may use, what was taught, and looking for each object."""
    taught = () if studio.library.lesson is None else studio.library.lesson.genes
    looks = [Behavior(name, (thing,)) for name in ("look", "is_seen") for thing in task.kinds]
    leaves = dict.fromkeys([*gene_pool(task).leaves, *taught, *looks])
    return sorted(leaves, key=lambda leaf: -leaf.kind)  # first what does most: genes, actions, questions


def _beside(part: Part, path: Path, key: str) -> Path:
    """Return the node that an arrow key leads to: the parent, the first child, or the nearest on the same level."""
    if key == "ArrowUp":
        return path[:-1]
    if key == "ArrowDown":
        return (*path, 0) if at(part, path).children else path
    level = [other for other in paths(part) if len(other) == len(path)]
    place = level.index(path) + (1 if key == "ArrowRight" else -1)
    return level[min(max(place, 0), len(level) - 1)]
