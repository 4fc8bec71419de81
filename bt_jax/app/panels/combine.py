"""Step 5: what was taught goes into the evolution, which goes on from there."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from bt_jax.app.panels.parts import button, heading
from bt_jax.app.studio import Studio
from bt_jax.app.tree_view import TreeView
from bt_jax.behaviors import parse_behavior
from bt_jax.encoding.words import Words
from bt_jax.errors import UserError
from bt_jax.lessons import Changes
from bt_jax.lfd import Lesson

if TYPE_CHECKING:
    from bt_jax.app.page import Page

__all__ = ["build"]

USES = {
    "target": "Its result is a new target, and its tree a model to breed from",
    "subgoal": "It is a step on the way: one whole, done once, and rewarded",
    "baseline": "Only its tree, as a model to breed from; the targets stay",
}
MOST = 100_000  # generations


def build(studio: Studio, page: Page) -> None:
    """What was learnt, how it is to be used, and where evolution is."""
    _Combine(studio, page)


class _Combine:
    def __init__(self, studio: Studio, page: Page) -> None:
        self.studio, self.page = studio, page
        with ui.element("div").classes("teach"):
            heading("What you taught")
            self.taught = ui.label().props("data-testid=combine-taught")
            with ui.element("div").classes("combine-tree") as self.drawing:
                self.tree = TreeView(page, testid="combine-tree")
            heading("How evolution uses it")
            self.use = ui.radio(USES, value="target", on_change=self._refresh).props("dense data-testid=combine-use")
            with ui.row().classes("items-center gap-3"):
                self.where = (
                    ui.select({}, label="Where it enters the tree", on_change=self._refresh)
                    .props("dense outlined data-testid=combine-where")
                    .classes("combine-where")
                )
                self.generations = (
                    ui.number("More generations", value=50, min=1, max=MOST, precision=0, step=1)
                    .props("dense outlined data-testid=combine-generations")
                    .classes("combine-number")
                )
            heading("What it will work for")
            self.targets = ui.element("ul").classes("lesson-list").props("data-testid=combine-targets")
            self.state = ui.label().props("data-testid=combine-state")
            with ui.row().classes("gap-2"):
                self.go = button("Go on evolving", "combine-go", "fast_forward", page.guard(self._go_on))
        page.on("lesson", self._refresh)
        page.on("evolution", self._refresh_state)
        page.on("task", self._refresh)

    def _refresh(self) -> None:
        lesson = self.studio.lesson
        self.taught.set_text(_taught(lesson, self.studio.teaching.problem))
        self.drawing.set_visibility(lesson is not None)
        if lesson is not None:
            self.tree.show(lesson.tree, lesson.task)
        self._refresh_targets(lesson)
        self._refresh_state()

    def _refresh_targets(self, lesson: Lesson | None) -> None:
        """The targets as they will be; what is new is marked."""
        known, problem = self.studio.task.targets, ""
        targets = known
        if lesson is not None and self.use.value == "target":
            try:
                targets = self.studio.task.with_targets(lesson.targets, source="the demonstrations").targets
            except UserError as error:
                problem = str(error)
        words, objects = Words(self.studio.task), [target.object for target in known]
        self.targets.clear()
        with self.targets:
            for target in targets:
                with ui.element("li"):
                    said = f"{target.object} {words.place(target.object, target.position, target.frame)}"
                    mark = "" if target in known else " (changed)" if target.object in objects else " (new)"
                    ui.label(said + mark).classes("text-bold" if mark else "")
            if lesson is not None and self.use.value == "subgoal":
                with ui.element("li"):
                    ui.label(f"on the way, once: {_reached(lesson, words)} (new)").classes("text-bold")
            if problem:
                ui.label(problem).classes("teach-bad").props("data-testid=combine-problem")

    def _refresh_state(self) -> None:
        evolution, lesson = self.studio.evolution, self.studio.lesson
        if evolution.run is None:
            sentence = "Nothing has been evolved yet: start in step 2, then come back."
        elif evolution.running:
            sentence = "Evolution is running: stop it in step 2 first."
        elif lesson is None:
            sentence = "Nothing has been taught yet: demonstrate in step 3."
        else:
            now = evolution.progress.generation if evolution.progress else 0
            sentence = f"Evolution goes on in the run {evolution.run}, from generation {now}."
        self.state.set_text(sentence)
        self.go.set_enabled(evolution.run is not None and not evolution.running and lesson is not None)
        self._refresh_places()

    def _refresh_places(self) -> None:
        """Where the learnt tree may enter: as a child of the root of another, or anywhere."""
        tree = self.studio.evolution.tree
        words, children = Words(self.studio.task), getattr(tree, "children", ())
        options = {-1: "anywhere, wherever it proves best"}
        for index, child in enumerate(children):
            options[index] = f"as step {index + 1}, before “{words(child)}”"
        options[len(children)] = f"as step {len(children) + 1}, at the end"
        if self.where.options != options:
            self.where.set_options(options, value=self.where.value if self.where.value in options else -1)

    async def _go_on(self) -> None:
        studio, lesson, use = self.studio, self.studio.lesson, self.use.value
        if lesson is None:
            raise UserError("nothing has been taught yet; demonstrate in step 3")
        generations = self.generations.value
        if generations is None or generations != int(generations):
            raise UserError("the number of generations is no whole number; write one into its field")
        path, index = studio.teaching.folder.path, self.where.value
        changes = Changes(
            baseline=lesson.tree if use == "baseline" else None,
            target_from=path if use == "target" else None,
            subgoal_from=path if use == "subgoal" else None,
            baseline_index=None if index in (None, -1) else int(index),
        )
        if studio.evolution.run is not None:
            config = studio.workspace.run(studio.evolution.run).config()
            await studio.work(changes.applied, config)  # says now what cannot be
        studio.evolution.next_phase(
            generations=int(generations),
            baseline=changes.baseline,
            target_from=changes.target_from,
            subgoal_from=changes.subgoal_from,
            baseline_index=changes.baseline_index,
        )
        studio.run = studio.evolution.run
        studio.changed("evolution")
        self.page.go("evolve")


def _taught(lesson: Lesson | None, problem: str) -> str:
    if lesson is None:
        return problem or "Nothing yet: demonstrate in step 3."
    count = len(lesson.demonstrations)
    return f"This tree, from {count} demonstration{'s' * (count > 1)}:"


def _reached(lesson: Lesson, words: Words) -> str:
    """What the demonstrations reach, as a subgoal."""
    return ", ".join(words.statement(parse_behavior(text)) for text in lesson.subgoal("taught").conditions)
