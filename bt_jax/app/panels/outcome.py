"""What came of looking for a tree: whether it works, what is not achieved yet, and where to go from here."""

from __future__ import annotations

from nicegui import ui

from bt_jax.app.panels.parts import button
from bt_jax.app.state.evolution_process import EvolutionProcess
from bt_jax.app.state.finding import STUCK, Lacking, commonest, lacking, stalled
from bt_jax.app.state.run_record import works
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.behaviors import Tree
from bt_jax.tasks import Task

__all__ = ["Outcome", "stage_color"]

COLORS = {"failed": "negative", "killed": "negative", "vanished": "negative", "paused": "warning"}
ENDED = ("finished", "stopped", "killed")


def stage_color(evolution: EvolutionProcess) -> str:
    """Return the colour of the stage: green only for a tree that works."""
    if evolution.stage in ("finished", "stopped") and evolution.result is not None:
        return "positive" if works(evolution.result) else "warning"
    return COLORS.get(evolution.stage, "primary")


class Outcome:
    """Sentences and buttons, in the container that is open; empty while all goes well."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self._about: tuple[Task, Tree] | None = None  # what was asked about last
        self._found: Lacking | None = None
        with ui.element("div").classes("outcome").props("data-testid=evolve-outcome role=status") as self.box:
            self.said = ui.label().classes("outcome-said").props("data-testid=evolve-outcome-said")
            self.list = ui.element("ul").classes("lesson-list").props("data-testid=evolve-lacking")
            with ui.row().classes("gap-2"):
                self.show = button("Show me how", "evolve-show", "pan_tool", page.guard(self._show))
                self.correct = button("Correct it by hand", "evolve-correct", "edit", page.guard(self._correct))
                self.watch = button("Watch it", "evolve-watch", "smart_display", lambda: page.go("run"))

    async def refresh(self) -> None:
        """Show what there is to say of the evolution."""
        evolution = self.studio.evolution
        stuck = self._is_stuck()
        fails = evolution.stage in ENDED and evolution.tree is not None and not self._works()
        found = await self._lacking() if stuck or (fails and evolution.result is None) else None
        if found is not None and not found.statements and not found.reason:
            stuck = fails = False  # it works where it was tried
        self.box.set_visibility(stuck or fails or self._works())
        self.show.set_text("Stuck? Show me how" if stuck else "Show me how")
        for control, wanted in ((self.show, stuck or fails), (self.correct, fails), (self.watch, not stuck)):
            control.set_visibility(wanted)
        said, lines = "", []
        if self._works():
            said = "It works."
        elif stuck and evolution.progress is not None:
            said = f"No better tree for {stalled(evolution.progress.history)} generations. Not achieved yet:"
        elif fails:
            sometimes = evolution.result is not None and evolution.result["success_rate"] > 0
            said = "It does not always work yet:" if sometimes else "It does not work yet:"
        if not self._works():
            lines = commonest(evolution.result) if evolution.result is not None else _lines(found)
        self.said.set_text(said)
        self.box.classes(add="bad" if stuck or fails else "", remove="" if stuck or fails else "bad")
        self._list(lines)

    def _list(self, lines: list[str]) -> None:
        if [label.text for label in self.list.descendants() if isinstance(label, ui.label)] == lines:
            return
        self.list.clear()
        with self.list:
            for line in lines:
                with ui.element("li"):
                    ui.label(line)

    def _works(self) -> bool:
        result = self.studio.evolution.result
        return result is not None and works(result)

    def _is_stuck(self) -> bool:
        """Return whether the evolution runs and has found nothing better for long."""
        evolution = self.studio.evolution
        if evolution.stage not in ("evolving", "paused") or evolution.progress is None:
            return False
        return stalled(evolution.progress.history) >= STUCK

    async def _lacking(self) -> Lacking | None:
        """Return what the best tree does not achieve; it is tried once."""
        evolution, worker = self.studio.evolution, self.studio.worker
        task, tree = evolution.task, evolution.tree
        if task is None or tree is None:
            return None
        if self._about != (task, tree):
            self._about, self._found = (task, tree), None
            seed = evolution.gp.seed if evolution.config is None else evolution.config.gp.seed
            self._found = await worker.work(lambda: lacking(task, worker.physics(task), tree, seed))
        return self._found

    def _show(self) -> None:
        """Stop the evolution, which keeps what it has, and go to where it can be shown."""
        if self.studio.evolution.running:
            self.studio.evolution.stop()
            self.studio.watch()
        self.page.go("demonstrate")

    def _correct(self) -> None:
        self.page.go("run")


def _lines(found: Lacking | None) -> list[str]:
    """Return what is lacking, and the reason."""
    if found is None:
        return ["looking for the reason"]
    return [*found.statements, *([f"because {found.reason}"] if found.reason else [])]
