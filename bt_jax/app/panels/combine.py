"""Step 5: what was taught goes into the evolution, which goes on from there."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Literal

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.parts import MOST, button, heading, whole, whole_field
from bt_jax.app.plain_words import Words
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Tree, parse_behavior
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Lesson
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

if TYPE_CHECKING:
    from bt_jax.app.page import Page, Step

__all__ = ["build"]

Use = Literal["target", "subgoal", "baseline"]
USES: dict[Use, str] = {
    "target": "Its result is a new target, and its tree a model to breed from",
    "subgoal": "It is a step on the way: one whole, done once, and rewarded",
    "baseline": "Only its tree, as a model to breed from; the targets stay",
}
ANYWHERE = -1


@dataclasses.dataclass(frozen=True)
class _Preview:
    """The task as it was and as it will be; `problem` says why it cannot become that."""

    before: Task
    after: Task
    problem: str = ""


def build(studio: Studio, page: Page) -> None:
    """What was learnt, how it is to be used, and where evolution is."""
    _Combine(studio, page)


class _Combine:
    def __init__(self, studio: Studio, page: Page) -> None:
        self.studio, self.page = studio, page
        self._asked = 0  # counts previews, so that only the newest is shown
        with ui.element("div").classes("teach"):
            heading("What you taught")
            self.taught = ui.label().props("data-testid=combine-taught")
            with ui.element("div").classes("combine-tree") as self.drawing:
                self.tree = TreeView(page, testid="combine-tree")
            heading("How evolution uses it")
            self.use = ui.radio(USES, value="target").props("dense data-testid=combine-use")
            self.use.on("update:model-value", page.guard(self._refresh))
            with ui.row().classes("items-center gap-3"):
                self.where = (
                    ui.select({}, label="Where it enters the tree")
                    .props("dense outlined data-testid=combine-where")
                    .classes("combine-where")
                )
                self.generations = whole_field("More generations", "combine-generations", 50)
                self.generations.classes("combine-number")
            heading("What it will work for")
            self.targets = ui.element("ul").classes("lesson-list").props("data-testid=combine-targets")
            self.state = ui.label().props("data-testid=combine-state")
            with ui.row().classes("gap-2"):
                self.go = button("Go on evolving", "combine-go", "fast_forward", page.guard(self._go_on))
        page.on("lesson", self._refresh)
        page.on("task", self._refresh)
        page.on("runs", self._refresh)
        page.on("evolution", self._refresh_state)
        page.on_step(self._enter)

    async def _enter(self, step: Step) -> None:
        if step == "combine":
            await self._refresh()

    async def _refresh(self) -> None:
        if self.page.step != "combine":
            return
        lesson = self.studio.lesson
        self.taught.set_text(_taught(lesson, self.studio.shelf.problem))
        self.drawing.set_visibility(lesson is not None)
        if lesson is not None:
            self.tree.show(lesson.tree, lesson.task)
        self._refresh_state()
        self._asked += 1
        asked, run, changes = self._asked, self._run(), self._changes()
        preview = await self.studio.work(_preview, self.studio.task, run, changes)
        if asked == self._asked:
            self._show(preview, lesson)

    def _run(self) -> RunFolder | None:
        """The folder of the evolution, None where there is none any more."""
        name = self.studio.evolution.run
        try:
            return None if name is None else self.studio.workspace.run(name)
        except UserError:
            return None

    def _changes(self) -> Changes:
        """What the evolution is to be changed by. Raises UserError where that is not known."""
        lesson, path = self.studio.lesson, self.studio.shelf.folder.path
        if lesson is None:
            return Changes()
        use, where = self.use.value, self.where.value
        return Changes(
            baseline=lesson.tree if use == "baseline" else None,
            target_from=path if use == "target" else None,
            subgoal_from=path if use == "subgoal" else None,
            baseline_index=None if where in (None, ANYWHERE) else int(where),
        )

    def _show(self, preview: _Preview, lesson: Lesson | None) -> None:
        """The targets as they will be; what is new is marked."""
        words, known = Words(preview.after), preview.before.targets
        objects = [target.object for target in known]
        self.targets.clear()
        with self.targets:
            for target in preview.after.targets:
                said = f"{target.object} {words.place(target.object, target.position, target.frame)}"
                mark = "" if target in known else " (changed)" if target.object in objects else " (new)"
                _line(said + mark, marked=bool(mark))
            for subgoal in preview.after.subgoals:
                if "{box}" in "".join(subgoal.conditions):
                    said = f"on the way, once: {subgoal.name}"
                else:
                    said = ", ".join(words.statement(parse_behavior(text)) for text in subgoal.conditions)
                    said = f"on the way, once: {said}"
                new = subgoal not in preview.before.subgoals
                _line(f"{said} (new)" if new else said, marked=new)
            if preview.problem:
                ui.label(preview.problem).classes("teach-bad").props("data-testid=combine-problem")

    def _refresh_state(self) -> None:
        if self.page.step != "combine":
            return
        evolution, lesson = self.studio.evolution, self.studio.lesson
        gone = self._run() is None
        if gone:
            sentence = "Nothing has been evolved yet: start in step 2, then come back."
        elif evolution.running:
            sentence = "Evolution is running: stop it in step 2 first."
        elif lesson is None:
            sentence = "Nothing has been taught yet: demonstrate in step 3."
        else:
            now = evolution.progress.generation if evolution.progress else 0
            sentence = f"Evolution goes on in the run {evolution.run}, from generation {now}."
        self.state.set_text(sentence)
        self.go.set_enabled(not gone and not evolution.running and lesson is not None)
        options = _places(evolution.tree, Words(self.studio.task))
        if self.where.options != options:
            self.where.set_options(options, value=self.where.value if self.where.value in options else ANYWHERE)

    async def _go_on(self) -> None:
        studio, generations = self.studio, whole(self.generations, 1, MOST)
        if studio.lesson is None:
            raise UserError("nothing has been taught yet; demonstrate in step 3")
        if studio.evolution.run is None:
            raise UserError("nothing has been evolved yet; start in step 2")
        folder, changes = studio.workspace.run(studio.evolution.run), self._changes()
        await studio.work(lambda: changes.applied(folder.config()))  # says now what cannot be
        studio.evolution.next_phase(
            generations=generations,
            baseline=changes.baseline,
            target_from=changes.target_from,
            subgoal_from=changes.subgoal_from,
            baseline_index=changes.baseline_index,
        )
        studio.run = studio.evolution.run
        studio.changed("evolution")
        self.page.go("evolve")


def _preview(task: Task, run: RunFolder | None, changes: Changes) -> _Preview:
    """What a run works for once the changes are made; without a run, what one for the task would."""
    try:
        config = RunConfig(task, GPConfig(), Settings()) if run is None else run.config()
        task = config.task
        return _Preview(task, changes.applied(config).task)
    except UserError as error:
        return _Preview(task, task, str(error))


def _places(tree: Tree | None, words: Words) -> dict[int, str]:
    """Where the learnt tree may enter another: as a child of its root, or anywhere."""
    children = getattr(tree, "children", ())
    options = {ANYWHERE: "anywhere, wherever it proves best"}
    for index, child in enumerate(children):
        options[index] = f"as step {index + 1}, before “{words(child)}”"
    options[len(children)] = f"as step {len(children) + 1}, at the end"
    return options


def _line(text: str, *, marked: bool) -> None:
    with ui.element("li"):
        ui.label(text).classes("text-bold" if marked else "")


def _taught(lesson: Lesson | None, problem: str) -> str:
    if lesson is None:
        return problem or "Nothing yet: demonstrate in step 3."
    count = len(lesson.demonstrations)
    return f"This tree, from {count} demonstration{'s' * (count > 1)}:"
