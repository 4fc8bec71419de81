"""Step 2: evolve a tree for the task; start, pause, resume, stop, go on, and see the best tree so far."""

from __future__ import annotations

import dataclasses
import time

from nicegui import ui

from bt_jax.app.panels.going_on import ask_goal
from bt_jax.app.panels.parts import MOST, button, heading, whole, whole_field
from bt_jax.app.state.evolution_process import EvolutionProcess
from bt_jax.app.state.run_record import tested
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext, Step
from bt_jax.app.widgets.learning_curve import LearningCurve, curve_options
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.gp.config import GPConfig
from bt_jax.training.progress import Progress

__all__ = ["build"]

NOTHING = "\N{EN DASH}"
CURVE_SECONDS = 2.0  # between two drawings of the curve while it grows
COLORS = {
    "finished": "positive",
    "failed": "negative",
    "killed": "negative",
    "vanished": "negative",
    "paused": "warning",
}


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
                self.population = _field("Population", "evolve-population", studio.evolution.gp.population)
                self.generations = _field("Generations", "evolve-generations", studio.evolution.gp.generations)
                self.generations.props("placeholder='until solved' stack-label").classes("evolve-generations")
                self.seed = _field("Seed", "evolve-seed", studio.evolution.gp.seed)
                self.start = button("Start", "evolve-start", "play_arrow", page.guard(self._start))
                self.pause = button("Pause", "evolve-pause", "pause", page.guard(self._pause_or_resume))
                self.stop = button("Stop", "evolve-stop", "stop", page.guard(self._stop))
            with ui.row().classes("items-center gap-3 w-full no-wrap"):
                self.bar = ui.linear_progress(0, show_value=False).props(
                    "instant-feedback data-testid=evolve-bar aria-label=Progress"
                )
                self.stage = ui.badge().props("data-testid=evolve-stage")
            with ui.row().classes("items-center gap-2 w-full no-wrap evolve-state"):
                self.sentence = ui.label().classes("flex-1").props("data-testid=evolve-sentence")
                with ui.row().classes("items-center gap-2 no-wrap") as self.onward:
                    self.more = _field("More generations", "evolve-more-generations", 50)
                    self.go_on = button("Go on", "evolve-more", "fast_forward", page.guard(self._more))
            with ui.row().classes("gap-6 evolve-figures"):
                self.generation = _figure("generation", "evolve-generation")
                self.best = _figure("best fitness (the closer to 0, the better)", "evolve-best")
                self.mean = _figure("mean of the population", "evolve-mean")
                self.episodes = _figure("episodes", "evolve-episodes")
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

    def _enter(self, step: Step) -> None:
        self._drawn = None
        self._refresh()

    def _gp(self) -> GPConfig:
        """Return the settings in the fields. Raise UserError for an invalid one."""
        gp = dataclasses.replace(
            self.studio.evolution.gp,
            population=whole(self.population, 8, MOST),
            generations=None if self.generations.value is None else whole(self.generations, 1, MOST),
            seed=whole(self.seed, 0, 2**32 - 1),
        )
        gp.check()
        return gp

    def _start(self) -> None:
        self.studio.start_evolution(self._gp())

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

    def _refresh(self) -> None:
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
        self.stage.props(f"color={COLORS.get(stage, 'primary')}")
        self.sentence.set_text(f"{evolution.sentence} {_tested(evolution)}")
        self.generation.set_text(f"{progress.generation} of {progress.generations}" if progress else NOTHING)
        self.best.set_text(_fitness(progress.best if progress else None))
        self.mean.set_text(_fitness(progress.mean if progress else None))
        self.episodes.set_text(f"{progress.episodes:,}" if progress else NOTHING)
        self.bar.set_value(progress.generation / max(progress.generations, 1) if progress else 0)
        self._draw(progress, evolution.phases, key=(stage, progress is None))
        self.tree.show(evolution.tree, evolution.task or self.studio.edited.task)

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


def _field(label: str, testid: str, value: int | None) -> ui.number:
    return whole_field(label, testid, value).classes("evolve-number")


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
    return f"Its best tree works in {tested(evolution.result)} layouts that it has never seen."
