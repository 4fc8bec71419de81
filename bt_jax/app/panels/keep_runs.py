"""The runs of the workspace: name, open, compare and report them, see where they fail, download trees and films."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import Callable
from typing import Any

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.app.panels.parts import button, heading, mark, may_leave
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.filming import film_run
from bt_jax.app.state.comparison import differences
from bt_jax.app.state.run_record import RunRecord, failures, read_record, read_records, success
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.dialogs import ask
from bt_jax.app.widgets.learning_curve import LearningCurve, curve_options
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Tree
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.formats.text import format_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.walk import prefix
from bt_jax.training.result import Failures
from bt_jax.training.run_note import LONGEST_NAME, RunNote

__all__ = ["FORMATS", "KeptRuns"]

COLUMNS: list[dict[str, Any]] = [
    {"name": "run", "label": "run", "field": "shown", "align": "left", "sortable": True},
    {"name": "task", "label": "task", "field": "task", "align": "left", "sortable": True},
    {"name": "tested", "label": "works in (95 %)", "field": "tested", "sortable": True},
    {"name": "best", "label": "best score", "field": "best", "sortable": True},
    {"name": "generation", "label": "rounds", "field": "generation", "sortable": True},
    {"name": "nodes", "label": "parts", "field": "nodes", "sortable": True},
]
TICK = """<q-checkbox v-model="props.selected" dense :aria-label="'Run ' + props.row.run" />"""
FORMATS: dict[str, Callable[[Tree], str]] = {"xml": to_xml, "svg": to_svg, "txt": format_tree}
NOTHING = "\N{EN DASH}"
REASONS = 5  # that are listed
STARTS = 12  # of one reason


class KeptRuns:
    """The list of runs, the buttons for the ticked ones, and their curves and trees."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self.records: dict[str, RunRecord] = {}
        self.problems: dict[str, UserError] = {}  # of runs that cannot be read
        self.chosen: list[str] = []
        self._noted = ""  # the run whose name and note are in the fields
        self._asked = 0  # counts readings, so that only the newest is shown
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
            self.open = button("Open", "keep-open", "folder_open", page.guard(self._open, steers="task"))
            self.report = button("Report", "keep-report", "description", lambda: None, more="target=_blank")
            self.downloads = [
                button("XML", "keep-xml", "download", page.guard(lambda: self._download("xml"))),
                button("SVG", "keep-svg", "download", page.guard(lambda: self._download("svg"))),
                button("Text", "keep-txt", "download", page.guard(lambda: self._download("txt"))),
                button("Film", "keep-film", "movie", page.guard(self._film)),
            ]
            self.delete = button("Delete", "keep-delete", "delete", page.guard(self._delete))
        with ui.row().classes("items-center gap-2 w-full no-wrap") as self.said:
            self.name = ui.input("Name").props(f"dense outlined data-testid=keep-name maxlength={LONGEST_NAME}")
            self.name.classes("keep-name")
            self.note = ui.input("Note").props("dense outlined autogrow data-testid=keep-note").classes("flex-1")
            button("Keep", "keep-note-save", "save", page.guard(self._say))
        self.chart = (
            ui.echart(curve_options([]), renderer="svg")
            .classes("evolve-chart")
            .props('data-testid=keep-chart role=img aria-label="Learning curves"')
        )
        self.different = ui.element("div").classes("keep-differences").props("data-testid=keep-differences")
        self.failing = ui.element("div").props("data-testid=keep-failing")
        with ui.element("div").classes("keep-trees") as self.sides:
            self.trees: list[_Side] = []
        page.on("runs", self._list)
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
        """Keep the ticks in the order in which they were set."""
        ticked = [row["run"] for row in self.table.selected]
        self.chosen = [*(name for name in self.chosen if name in ticked), *(n for n in ticked if n not in self.chosen)]
        self._show()

    def _show(self) -> None:
        shown = [self.records[name] for name in self.chosen]
        only = shown[0] if len(shown) == 1 else None
        if not self.records:
            self.hint.set_text("There is no run yet; start an evolution in step 2.")
        else:
            self.hint.set_text("Tick one run to open it or to download its tree, several to compare them.")
        root = self.studio.workspace.root
        left_out = [f"{name} is left out: {phrase(problem, root)}." for name, problem in self.problems.items()]
        self.left_out.set_text("\n".join(left_out))
        self.left_out.set_visibility(bool(left_out))
        for one in (self.open, self.report, *self.downloads):
            one.set_enabled(only is not None)
        self.delete.set_enabled(bool(shown))
        self.report.props(f'href="/report/{only.name}"' if only else "", remove="" if only else "href")
        self._show_note(only)
        curves = [
            LearningCurve(_called(one, shown), one.progress.history, one.phases)
            for one in shown
            if one.progress is not None
        ]
        self.chart.options.clear()
        self.chart.options.update(curve_options(curves))
        self.chart.update()
        self.chart.set_visibility(bool(curves))
        self._show_differences(shown)
        self._show_failures(only)
        with self.sides:
            self.trees += [_Side(number) for number in range(len(self.trees), len(shown))]
        for number, side in enumerate(self.trees):
            side.show(shown[number] if number < len(shown) else None)

    def _show_note(self, only: RunRecord | None) -> None:
        """Show what was said about the run; what a person writes meanwhile stays."""
        self.said.set_visibility(only is not None)
        name = "" if only is None else only.name
        if only is not None and name != self._noted:
            self.name.set_value(only.note.name)
            self.note.set_value(only.note.note)
        self._noted = name

    def _show_differences(self, shown: list[RunRecord]) -> None:
        self.different.clear()
        if len(shown) < 2:
            return
        rows = differences(shown)
        with self.different:
            heading("What differs")
            if not rows:
                ui.label("All settings are the same, and so is the task.").classes("hint")
                return
            columns = [{"name": "setting", "label": "", "field": "setting", "align": "left"}]
            columns += [
                {"name": str(i), "label": _called(one, shown), "field": str(i), "align": "left"}
                for i, one in enumerate(shown)
            ]
            cells = [{"setting": row.name, **{str(i): value for i, value in enumerate(row.values)}} for row in rows]
            ui.table(columns=columns, rows=cells, row_key="setting").props("dense flat bordered wrap-cells")

    def _show_failures(self, only: RunRecord | None) -> None:
        self.failing.clear()
        result = None if only is None else only.result
        if only is None or result is None:
            return
        rate, reasons = success(result), failures(result)
        with self.failing:
            heading("Where it fails")
            if rate.solved == rate.tried:
                ui.label(f"Nowhere: it works in all {rate.tried} starts of the test.").classes("hint")
                return
            ui.label(f"It works in {rate}. Press a number to watch what happens there.").classes("hint")
            for group in reasons[:REASONS]:
                self._reason(only.name, group)
            rest = rate.tried - rate.solved - sum(len(group.layouts) for group in reasons[:REASONS])
            if rest > 0:
                ui.label(f"{counted(rest, 'time')} for other reasons, or for ones that were not looked into.")

    def _reason(self, run: str, group: Failures) -> None:
        with ui.row().classes("items-center gap-1"):
            ui.label(f"{counted(len(group.layouts), 'time')}: {group.reason}").classes("w-full")
            draws = group.draws or (1,) * len(group.layouts)
            for layout, draw in list(zip(group.layouts, draws, strict=False))[:STARTS]:
                text = f"{layout}.{draw}" if group.draws else f"{layout}"
                watch = self.page.guard(functools.partial(self._replay, run, layout, draw), steers="task")
                one = ui.button(text, on_click=watch).props("no-caps outline dense").classes("keep-start")
                mark(one, f"keep-replay-{text}", aria_label=f"Watch start {text}")
            if len(group.layouts) > STARTS:
                ui.label(f"and {len(group.layouts) - STARTS} more").classes("hint")

    async def _replay(self, run: str, layout: int, draw: int) -> None:
        record = await asyncio.to_thread(read_record, self.studio.workspace.run(run))
        if record.config.task != self.studio.edited.task and not await may_leave(self.studio):
            return
        self._steer()
        await self.studio.replay(run, layout, draw)
        self.page.go("run")
        self.page.steer("run")  # another step lets go of what the one before has steered
        self.studio.playing.play()
        self.page.say(f"This is start {layout} of the test of {record.title}.")

    async def _one(self) -> RunRecord:
        """Return the ticked run as it is now. Raise UserError if it has gone."""
        if len(self.chosen) != 1:
            raise UserError("tick exactly one run in the list")
        return await asyncio.to_thread(read_record, self.studio.workspace.run(self.chosen[0]))

    async def _open(self) -> None:
        record = await self._one()
        if record.config.task != self.studio.edited.task and not await may_leave(self.studio):
            return
        self._steer()
        self.studio.open_run(record.name)
        self.page.say(
            f"The run {record.name} is open: run its tree in step 6, or go on evolving it in step 2.", "success"
        )

    def _steer(self) -> None:
        """Steer the task and the running tree; again, since a person may take their time to answer."""
        self.page.steer("task")
        self.page.steer("run")

    async def _say(self) -> None:
        record = await self._one()
        await self.studio.keeping.note(record.name, RunNote(self.name.value or "", self.note.value or ""))
        self._noted = ""  # as it is kept
        self.page.say(f"Name and note are kept with {record.name}.", "success")

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
        names = list(self.chosen)
        what = f"the run {names[0]}" if len(names) == 1 else f"these {len(names)} runs"
        if not await ask(f"Move {what} into the trash?", yes="Delete", testid="keep-delete"):
            return
        for name in names:
            await self.studio.delete_run(name)
        self.page.say(f"{what[0].upper()}{what[1:]} can be restored from the trash.", "success")


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
        title = record.title if record.title == record.name else f"{record.title} ({record.name})"
        self.name.set_text(title if best is None else f"{title}: {best:.1f}".replace(": -", ": \N{MINUS SIGN}"))
        self.tree.show(record.tree, record.config.task)


def _called(record: RunRecord, among: list[RunRecord]) -> str:
    """Return the title of a run, or the name of its folder if another of these has the same title."""
    return record.title if sum(one.title == record.title for one in among) == 1 else record.name


def _works(result: dict[str, Any]) -> str:
    found = success(result)
    return f"{found.solved} of {found.tried}\n{100 * found.low:.0f} to {100 * found.high:.0f} %"


def _row(record: RunRecord) -> dict[str, object]:
    progress = record.progress
    return {
        "run": record.name,
        "shown": record.name if record.title == record.name else f"{record.title} ({record.name})",
        "task": record.config.task.name,
        "generation": progress.generation if progress else 0,
        "best": round(progress.best, 1) if progress and progress.best is not None else NOTHING,
        "tested": _works(record.result) if record.result else NOTHING,
        "nodes": len(prefix(record.tree)) if record.tree is not None else NOTHING,
    }
