"""Step 7: the runs of the workspace; open one, compare two, download trees and films."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import button, may_leave
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.filming import film_run
from bt_jax.app.state.run_record import RunRecord, read_record, read_records, tested
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.dialogs import ask
from bt_jax.app.widgets.learning_curve import LearningCurve, curve_options
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Tree
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.formats.xml import to_xml

__all__ = ["build"]

COLUMNS: list[dict[str, Any]] = [
    {"name": "run", "label": "run", "field": "run", "align": "left", "sortable": True},
    {"name": "task", "label": "task", "field": "task", "align": "left", "sortable": True},
    {"name": "generation", "label": "generations", "field": "generation", "sortable": True},
    {"name": "best", "label": "best fitness", "field": "best", "sortable": True},
    {"name": "tested", "label": "works in", "field": "tested"},
]
TICK = """<q-checkbox v-model="props.selected" dense :aria-label="'Run ' + props.row.run" />"""
FORMATS: dict[str, Callable[[Tree], str]] = {"xml": to_xml, "svg": to_svg, "txt": format_tree}
NOTHING = "\N{EN DASH}"


def build(studio: Studio, page: PageContext) -> None:
    """Build the list of runs, the buttons for the ticked ones, and their curves and trees."""
    _Keep(studio, page)


class _Keep:
    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self.records: dict[str, RunRecord] = {}
        self.problems: dict[str, UserError] = {}  # of runs that cannot be read
        self.chosen: list[str] = []
        self._asked = 0  # counts readings, so that only the newest is shown
        with ui.element("div").classes("keep"):
            self.hint = ui.label().props("data-testid=keep-hint")
            self.left_out = ui.label().classes("whitespace-pre-line break-words").props("data-testid=keep-left-out")
            self.table = (
                ui.table(columns=COLUMNS, rows=[], row_key="run", selection="multiple", on_select=self._select)
                .props("dense flat bordered hide-selected-banner wrap-cells data-testid=keep-runs")
                .classes("keep-runs")
            )
            self.table.add_slot("header-selection", '<span class="visually-hidden">ticked</span>')
            self.table.add_slot("body-selection", TICK)
            with ui.row().classes("items-center gap-2"):
                self.buttons = [
                    button("Open", "keep-open", "folder_open", page.guard(self._open, steers="task")),
                    button("XML", "keep-xml", "download", page.guard(lambda: self._download("xml"))),
                    button("SVG", "keep-svg", "download", page.guard(lambda: self._download("svg"))),
                    button("Text", "keep-txt", "download", page.guard(lambda: self._download("txt"))),
                    button("Film", "keep-film", "movie", page.guard(self._film)),
                    button("Delete", "keep-delete", "delete", page.guard(self._delete)),
                ]
            self.chart = (
                ui.echart(curve_options([]), renderer="svg")
                .classes("evolve-chart")
                .props('data-testid=keep-chart role=img aria-label="Learning curves"')
            )
            with ui.row().classes("w-full no-wrap gap-2 keep-trees"):
                self.trees = [_Side(number) for number in range(2)]
        page.on("runs", self._list, now=False)
        page.on_step(self._list)

    async def _list(self, *_: object) -> None:
        """Read the runs again, if this step is shown."""
        if self.page.step != "keep":
            return
        self._asked += 1
        asked, read = self._asked, await asyncio.to_thread(read_records, self.studio.workspace)
        if asked != self._asked:
            return
        self.records, self.problems = read
        self.chosen = [name for name in self.chosen if name in self.records]
        self.table.rows = [_row(record) for record in self.records.values()]
        self.table.selected = [row for row in self.table.rows if row["run"] in self.chosen]
        self._show()

    def _select(self) -> None:
        """Keep at most two ticks: the last two."""
        ticked = [row["run"] for row in self.table.selected]
        self.chosen = [*(name for name in self.chosen if name in ticked), *(n for n in ticked if n not in self.chosen)][
            -2:
        ]
        self.table.selected = [row for row in self.table.rows if row["run"] in self.chosen]
        self._show()

    def _show(self) -> None:
        shown = [self.records[name] for name in self.chosen]
        if not self.records:
            self.hint.set_text("There is no run yet; start an evolution in step 2.")
        else:
            self.hint.set_text("Tick one run to open it or to download its tree, two to compare them.")
        root = self.studio.workspace.root
        left_out = [f"{name} is left out: {phrase(problem, root)}." for name, problem in self.problems.items()]
        self.left_out.set_text("\n".join(left_out))
        self.left_out.set_visibility(bool(left_out))
        for one in self.buttons:
            one.set_enabled(len(shown) == 1)
        curves = [
            LearningCurve(one.name, one.progress.history, one.phases) for one in shown if one.progress is not None
        ]
        self.chart.options.clear()
        self.chart.options.update(curve_options(curves))
        self.chart.update()
        self.chart.set_visibility(bool(curves))
        for number, side in enumerate(self.trees):
            side.show(shown[number] if number < len(shown) else None)

    async def _one(self) -> RunRecord:
        """Return the ticked run as it is now. Raise UserError if it has gone."""
        if len(self.chosen) != 1:
            raise UserError("tick exactly one run in the list")
        return await asyncio.to_thread(read_record, self.studio.workspace.run(self.chosen[0]))

    async def _open(self) -> None:
        record = await self._one()
        if record.config.task != self.studio.edited.task and not await may_leave(self.studio):
            return
        for thing in ("task", "run"):  # a person may take their time to answer
            self.page.steer(thing)
        self.studio.open_run(record.name)
        self.page.say(
            f"The run {record.name} is open: run its tree in step 6, or go on evolving it in step 2.", "success"
        )

    async def _download(self, kind: str) -> None:
        record = await self._one()
        if record.tree is None:
            raise UserError(f"{record.name} has no tree yet; let it evolve a generation")
        ui.download.content(FORMATS[kind](record.tree), f"{record.name}.{kind}")
        self.page.say(f"The tree of {record.name} is in your downloads, as {record.name}.{kind}.", "success")

    async def _film(self) -> None:
        record = await self._one()
        folder = self.studio.workspace.run(record.name).path.resolve()
        self.page.say(f"Filming {record.name}; this takes a while, and you can go on.")
        ui.download.file(await film_run(folder), f"{record.name}.mp4")
        self.page.say(f"The film of {record.name} is in your downloads, and in its folder.", "success")

    async def _delete(self) -> None:
        name = (await self._one()).name
        question = f"Delete the run {name} for good, with its trees and curves?"
        if await ask(question, yes="Delete", testid="keep-delete"):
            await self.studio.delete_run(name)
            self.page.say(f"The run {name} is deleted.", "success")


class _Side:
    """The name and the best tree of one run."""

    def __init__(self, number: int) -> None:
        with ui.column().classes("gap-1 keep-side") as self.area:
            self.name = ui.label().classes("text-bold").props(f"data-testid=keep-name-{number}")
            self.tree = TreeView(testid=f"keep-tree-{number}")

    def show(self, record: RunRecord | None) -> None:
        self.area.set_visibility(record is not None)
        if record is None:
            return
        best = record.progress and record.progress.best
        self.name.set_text(
            record.name if best is None else f"{record.name}: {best:.1f}".replace(": -", ": \N{MINUS SIGN}")
        )
        self.tree.show(record.tree, record.config.task)


def _row(record: RunRecord) -> dict[str, object]:
    progress = record.progress
    return {
        "run": record.name,
        "task": record.config.task.name,
        "generation": progress.generation if progress else 0,
        "best": progress.best if progress and progress.best is not None else NOTHING,
        "tested": f"{tested(record.result)} layouts" if record.result else NOTHING,
    }
