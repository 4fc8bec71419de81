"""Step 5: what was taught becomes part of the evolution, which goes on from there."""

from __future__ import annotations

import dataclasses
from typing import Literal

from nicegui import ui

from bt_jax._util.errors import UserError
from bt_jax.app.panels.going_on import ask_goal
from bt_jax.app.panels.parts import MOST, button, heading, whole, whole_field
from bt_jax.app.phrases import phrase
from bt_jax.app.plain_words import Words
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext, Step
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Tree, parse_behavior
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Lesson
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

__all__ = ["build"]

Use = Literal["target", "subgoal", "baseline"]
USES: dict[Use, str] = {
    "target": "Its result is a new target, and its tree is a model to breed from",
    "subgoal": "It is a step on the way: done once as a whole, and rewarded",
    "baseline": "Only its tree, as a model to breed from; the targets stay",
}
ANYWHERE = -1


@dataclasses.dataclass(frozen=True)
class _Preview:
    """The task as it is and as it will be; `problem` says why it cannot be changed like this, None if it can. `anywhere`:
    the evolution finds out by itself where the learnt tree belongs."""

    before: Task
    after: Task
    anywhere: bool = False
    problem: UserError | None = None


def build(studio: Studio, page: PageContext) -> None:
    """Build what was learnt, how it is to be used, and the state of the evolution."""
    _Combine(studio, page)


class _Combine:
    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self._asked = 0  # counts previews, so that only the newest is shown
        with ui.element("div").classes("teach"):
            heading("What you taught")
            self.taught = ui.label().props("data-testid=combine-taught")
            with ui.element("div").classes("combine-tree") as self.drawing:
                self.tree = TreeView(testid="combine-tree")
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
        lesson = self.studio.library.lesson
        self.taught.set_text(_taught(lesson, self.studio.library.problem))
        self.drawing.set_visibility(lesson is not None)
        if lesson is not None:
            self.tree.show(lesson.tree, lesson.task)
        self._refresh_state()
        self._asked += 1
        asked, run, changes = self._asked, self._run(), self._changes()
        preview = await self.studio.worker.work(_preview, self.studio.edited.task, run, changes)
        if asked == self._asked:
            self._show(preview, lesson)

    def _run(self) -> RunFolder | None:
        """Return the folder of the evolution, None if there is none."""
        name = self.studio.evolution.run
        try:
            return None if name is None else self.studio.workspace.run(name)
        except UserError:
            return None

    def _changes(self) -> Changes:
        """Return what is to change in the evolution."""
        lesson, path = self.studio.library.lesson, self.studio.library.folder.path
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
        """Show the targets as they will be; new ones are marked."""
        words, known = Words(preview.after), preview.before.targets
        objects = [target.object for target in known if target.object in preview.before.object_names]
        self.where.set_visibility(not preview.anywhere)
        if preview.anywhere:
            self.where.set_value(ANYWHERE)
        self.targets.clear()
        with self.targets:
            for target in preview.after.targets:
                said = f"{words.named(target.object)} {words.target(target)}"
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
            if preview.problem is not None:
                ui.label(phrase(preview.problem, self.studio.workspace.root)).classes("teach-bad").props(
                    "data-testid=combine-problem"
                )

    def _refresh_state(self) -> None:
        if self.page.step != "combine":
            return
        evolution, lesson = self.studio.evolution, self.studio.library.lesson
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
        options = _places(evolution.tree, Words(self.studio.edited.task))
        if self.where.options != options:
            self.where.set_options(options, value=self.where.value if self.where.value in options else ANYWHERE)

    async def _go_on(self) -> None:
        studio, generations = self.studio, whole(self.generations, 1, MOST)
        if studio.library.lesson is None:
            raise UserError("nothing has been taught yet; demonstrate in step 3")
        if studio.evolution.run is None:
            raise UserError("nothing has been evolved yet; start in step 2")
        folder = studio.workspace.run(studio.evolution.run)
        changes = await ask_goal(studio, self._changes())
        if changes is None:
            return
        await studio.worker.work(lambda: changes.applied(folder.config()))  # says now what is impossible
        studio.go_on(generations, changes)
        self.page.go("evolve")


def _preview(task: Task, run: RunFolder | None, changes: Changes) -> _Preview:
    """Return what a run works for after the changes; without a run, what a new run for the task would."""
    anywhere = False
    try:
        config = RunConfig(task, GPConfig(), Settings()) if run is None else run.config()
        task, anywhere = config.task, config.gp.method == "achievements"
        return _Preview(task, changes.applied(config).task, anywhere)
    except UserError as error:
        return _Preview(task, task, anywhere, error)


def _places(tree: Tree | None, words: Words) -> dict[int, str]:
    """Return where the learnt tree may enter another: as a child of its root, or anywhere."""
    children = getattr(tree, "children", ())
    options = {ANYWHERE: "anywhere; evolution decides"}
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
