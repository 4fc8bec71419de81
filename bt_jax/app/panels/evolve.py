"""Step 2: find a tree for the task, by planning or by evolution; pause, stop, go on, and see the best tree so far."""

from __future__ import annotations

import time

from nicegui import ui

from bt_jax.app.panels.going_on import ask_goal
from bt_jax.app.panels.outcome import Outcome, stage_color
from bt_jax.app.panels.parts import MOST, button, heading, whole, whole_field
from bt_jax.app.panels.search_settings import Advanced, Trouble
from bt_jax.app.processes.train_command import ANYWHERE
from bt_jax.app.state.evolution_process import EvolutionProcess
from bt_jax.app.state.finding import Search, found_by, plan_first
from bt_jax.app.state.run_record import tested
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext, Step
from bt_jax.app.widgets.learning_curve import LearningCurve, curve_options
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.training.progress import Progress

__all__ = ["build"]

NOTHING = "\N{EN DASH}"
CURVE_SECONDS = 2.0  # between two drawings of the curve while it grows


def build(studio: Studio, page: PageContext) -> None:
    """Build the controls, the numbers, the learning curve and the best tree."""
    _Evolve(studio, page)


class _Evolve:
    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self._drawn: object = None
        self._drawn_at = 0.0
        with ui.element("div").classes("evolve"):
            with ui.row().classes("items-center gap-2"):
                self.start = button("Find a tree", "evolve-start", "play_arrow", page.guard(self._start))
                self.pause = button("Pause", "evolve-pause", "pause", page.guard(self._pause_or_resume))
                self.stop = button("Stop", "evolve-stop", "stop", page.guard(self._stop))
                Trouble(studio, page)
            self.advanced = Advanced(studio)
            with ui.row().classes("items-center gap-3 w-full no-wrap"):
                self.bar = ui.linear_progress(0, show_value=False).props(
                    "instant-feedback data-testid=evolve-bar aria-label=Progress"
                )
                self.stage = ui.badge().props("data-testid=evolve-stage")
            with ui.row().classes("items-center gap-2 w-full no-wrap evolve-state"):
                self.sentence = ui.label().classes("flex-1").props("data-testid=evolve-sentence")
                with ui.row().classes("items-center gap-2 no-wrap") as self.onward:
                    self.more = whole_field("More generations", "evolve-more-generations", 50).classes("evolve-number")
                    self.go_on = button("Go on", "evolve-more", "fast_forward", page.guard(self._more))
            self.outcome = Outcome(studio, page)
            with ui.row().classes("gap-6 evolve-figures"):
                self.generation = _figure("generation", "evolve-generation")
                self.best = _figure("best score (the closer to 0, the better)", "evolve-best")
                self.mean = _figure("mean of the population", "evolve-mean")
                self.episodes = _figure("attempts", "evolve-episodes")
            self.chart = (
                ui.echart(curve_options([]), renderer="svg")
                .classes("evolve-chart")
                .props('data-testid=evolve-chart role=img aria-label="Learning curve"')
            )
            heading("Best tree so far")
            with ui.element("div").classes("evolve-tree"):
                self.tree = TreeView(testid="evolve-tree")
        page.on("evolution", self._refresh)
        page.on_step(self._enter)

    async def _enter(self, step: Step) -> None:
        self._drawn = None
        await self._refresh()

    async def _start(self) -> None:
        studio, gp, task = self.studio, self.advanced.settings(), self.studio.edited.task
        search = Search(gp, ANYWHERE)
        if self.advanced.plans and not studio.evolution.running and gp.method == "achievements":
            search = await studio.worker.work(plan_first, task, gp)
        studio.start_evolution(search.gp, search.begin)
        if search.no_plan:
            self.page.say(f"There is no plan, so a tree is evolved: {search.no_plan}.")

    def _pause_or_resume(self) -> None:
        evolution = self.studio.evolution
        (evolution.resume if evolution.stage == "paused" else evolution.pause)()
        self.studio.watch()

    def _stop(self) -> None:
        self.studio.evolution.stop()
        self.studio.watch()

    async def _more(self) -> None:
        generations = whole(self.more, 1, MOST)
        changes = await ask_goal(self.studio)
        if changes is not None:
            self.studio.go_on(generations, changes)

    async def _refresh(self) -> None:
        if self.page.step != "evolve":
            return
        evolution = self.studio.evolution
        stage, progress, running = evolution.stage, evolution.progress, evolution.running
        if progress is not None and progress.best is None:
            progress = None  # nothing was measured yet
        self.start.set_enabled(not running)
        self.pause.set_text("Resume" if stage == "paused" else "Pause")
        self.pause.set_icon("play_arrow" if stage == "paused" else "pause")
        self.pause.set_enabled(stage in ("evolving", "paused"))
        self.stop.set_enabled(running and stage not in ("stopping", "testing"))
        self.onward.set_visibility(not running and progress is not None and stage != "vanished")
        self.stage.set_text(stage if stage != "none" else "not started")
        self.stage.props(f"color={stage_color(evolution)}")
        found = found_by(evolution.config, evolution.tree) if stage in ("finished", "stopped") else ""
        self.sentence.set_text(" ".join(filter(None, (evolution.sentence, found, _tested(evolution)))))
        self.generation.set_text(f"{progress.generation} of {progress.generations}" if progress else NOTHING)
        self.best.set_text(_fitness(progress.best if progress else None))
        self.mean.set_text(_fitness(progress.mean if progress else None))
        self.episodes.set_text(f"{progress.episodes:,}" if progress else NOTHING)
        self.bar.set_value(progress.generation / max(progress.generations, 1) if progress else 0)
        self._draw(progress, evolution.phases, key=(stage, progress is None))
        self.tree.show(evolution.tree, evolution.task or self.studio.edited.task)
        await self.outcome.refresh()

    def _draw(self, progress: Progress | None, phases: tuple[int, ...], *, key: object) -> None:
        """Draw the curve, which takes a browser long: at once if `key` has changed, else now and then."""
        now = time.monotonic()
        if key == self._drawn and now - self._drawn_at < CURVE_SECONDS:
            return
        self._drawn, self._drawn_at = key, now
        curves = [LearningCurve("", progress.history, phases)] if progress and progress.history else []
        self.chart.options.clear()
        self.chart.options.update(curve_options(curves, generations=progress.generations if progress else 0))
        self.chart.update()


def _figure(name: str, testid: str) -> ui.label:
    """Return a number above its name."""
    with ui.column().classes("gap-0"):
        value = ui.label(NOTHING).classes("evolve-figure").props(f"data-testid={testid}")
        ui.label(name).classes("evolve-caption")
    return value


def _fitness(value: float | None) -> str:
    return NOTHING if value is None else f"{value:,.1f}".replace("-", "\N{MINUS SIGN}")


def _tested(evolution: EvolutionProcess) -> str:
    """Say how often the best tree works in layouts of the test."""
    if evolution.result is None:
        return ""
    return f"Its best tree works in {tested(evolution.result)} starts that it has never seen."
