"""Step 4: what was inferred from the demonstrations, and why; a person may choose another reference for a place."""

from __future__ import annotations

import functools
import math
import re

from nicegui import ui
from nicegui.events import ValueChangeEventArguments

from bt_jax._util.errors import UserError
from bt_jax._util.words import counted
from bt_jax.app.panels.keep_runs import FORMATS
from bt_jax.app.panels.parts import button, heading, known
from bt_jax.app.panels.questions import Questions
from bt_jax.app.plain_words import Words
from bt_jax.app.processes.trial import LAYOUTS
from bt_jax.app.state.studio import Studio
from bt_jax.app.units import length
from bt_jax.app.widgets.clusters import cluster_svg, scores
from bt_jax.app.widgets.context import PageContext
from bt_jax.app.widgets.tree_view import TreeView
from bt_jax.behaviors import Behavior, Kind
from bt_jax.lfd import Lesson
from bt_jax.lfd.clustering import NEEDED, SPREAD_FLOOR, Candidate
from bt_jax.lfd.explanation import order_sentences, precondition_sentences
from bt_jax.lfd.inference import Inference

__all__ = ["build"]

SQUARES = (
    "Each square shows from above where you put the object, relative to one thing: a dot for each demonstration. The closer "
    "the dots, the more likely this is what you meant. Click a square to choose it."
)


def build(studio: Studio, page: PageContext) -> None:
    """Build what is open, a card for each action, then the goal, the order and the tree."""
    _Understand(studio, page)


class _Understand:
    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page = studio, page
        self.open: set[int] = set()  # actions whose reasons are unfolded
        with ui.element("div").classes("teach"):
            self.head = ui.element("div").classes("teach")
            self.questions = Questions(studio, page)
            self.area = ui.element("div").classes("teach")
            self.learnt = ui.element("div").classes("teach")
            with self.learnt:
                with ui.row().classes("gap-2 items-center w-full"):
                    heading("Learnt tree").classes("flex-1")
                    button(
                        "Run it", "understand-run", "play_arrow", page.guard(self._run, steers="run"), more="outline"
                    )
                    combine = page.guard(lambda: page.go("combine"))
                    button("Combine with evolution", "understand-combine", "merge", combine)
                with ui.row().classes("gap-2 items-center w-full"):
                    text = f"Try it from {LAYOUTS} starts"
                    self.try_out = button(text, "understand-try", "casino", page.guard(self._try_out), more="outline")
                    ui.label("Download").classes("teach-hint")
                    for kind in FORMATS:
                        download = page.guard(functools.partial(self._download, kind))
                        button(kind.upper(), f"understand-{kind}", "download", download, more="flat")
                self.trial = ui.label().props("data-testid=understand-trial")
                with ui.element("div").classes("lesson-tree"):
                    self.tree = TreeView(testid="understand-tree")
        page.on("lesson", self._refresh)

    def _refresh(self) -> None:
        lesson, library = self.studio.library.lesson, self.studio.library
        self.head.clear()
        self.area.clear()
        self.learnt.set_visibility(lesson is not None)
        if lesson is not None:
            self.tree.show(lesson.tree, lesson.task)
        self.try_out.set_enabled(not library.trying)
        trying = "Running it; this takes a while the first time." if library.trying else ""
        self.trial.set_text(library.trial.sentence if library.trial else trying)
        self.trial.set_visibility(bool(self.trial.text))
        with self.head:
            ui.label(library.progress).props("data-testid=understand-progress")
            if library.problem:
                ui.label(library.problem).classes("teach-landing teach-bad").props("data-testid=understand-problem")
            if lesson is None:
                button("Demonstrate", "understand-demonstrate", "back_hand", lambda: self.page.go("demonstrate"))
                return
            if lesson.missing:
                ui.label(
                    f"With fewer than {NEEDED}, every place is taken as fixed on the table. If that is wrong, "
                    "choose below what a place is relative to."
                ).classes("teach-landing").props("data-testid=understand-missing")
        with self.area:
            self._lesson(lesson)

    def _lesson(self, lesson: Lesson) -> None:
        heading("What was done, and what each place is relative to")
        for index, inference in enumerate(lesson.inferences):
            self._action(lesson, index, inference)
        self._goal(lesson)

    def _action(self, lesson: Lesson, index: int, inference: Inference) -> None:
        words, count = Words(lesson.task), len({instance.demonstration for instance in inference.instances})
        with ui.element("div").classes("lesson-action").props(f"data-testid=understand-action-{index + 1}"):
            with ui.element("div").classes("lesson-title"):
                title = ui.label(f"{index + 1}. {words(inference.behavior)}").classes("text-bold")
                title.props(f'title="{inference.behavior}"')
                of = counted(len(lesson.demonstrations), "demonstration")
                ui.label(f"in {count} of {of}").classes("teach-hint")
            if inference.kind == "pick":
                return
            why = ui.expansion("Why?", value=index in self.open, on_value_change=functools.partial(self._fold, index))
            with why.props(f"dense data-testid=understand-why-{index + 1}").classes("lesson-why"):
                with ui.element("div").classes("lesson-frames").props('role=group aria-label="Relative to"'):
                    for frame, candidate in scores(lesson, inference).items():
                        self._frame(lesson, index, inference, frame, candidate)
                ui.label(SQUARES).classes("teach-hint")
                ui.label(_reason(inference, lesson)).classes("teach-hint").props(
                    f"data-testid=understand-reason-{index + 1}"
                )
            if inference.chosen:
                back = self.page.guard(functools.partial(self.studio.library.choose_frame, index, None))
                button("As the demonstrations say", f"understand-auto-{index + 1}", "undo", back, more="flat")

    def _fold(self, index: int, event: ValueChangeEventArguments) -> None:
        """Remember which reasons are unfolded when all of it is built again."""
        if event.value:
            self.open.add(index)
        else:
            self.open.discard(index)

    def _frame(self, lesson: Lesson, index: int, inference: Inference, frame: str, candidate: Candidate | None) -> None:
        chosen = frame == inference.frame
        choose = self.page.guard(functools.partial(self._choose, index, frame))
        card = ui.element("button").classes("lesson-frame").on("click", choose)
        card.props(f"type=button aria-pressed={str(chosen).lower()} data-testid=understand-frame-{index + 1}-{frame}")
        with card:
            ui.label(known(frame, lesson.task, robot="a fixed place")).classes("text-bold")
            ui.html(cluster_svg(lesson, inference, frame, task=lesson.task), sanitize=False)
            ui.label(_agreement(candidate)).classes("lesson-score")
            if candidate is not None and candidate.score > -math.inf:
                ui.label(f"score {candidate.score:,.0f}").classes("lesson-score")

    async def _choose(self, index: int, frame: str) -> None:
        lesson = self.studio.library.lesson
        if lesson is None or index >= len(lesson.inferences):
            return  # another window has changed it
        if lesson.inferences[index].frame == frame and lesson.inferences[index].chosen:
            return
        await self.studio.library.choose_frame(index, frame)
        self.page.say(f"The place is now relative to {frame}, and the tree is learnt again.", "success")

    def _goal(self, lesson: Lesson) -> None:
        words = Words(lesson.task)
        if len(lesson.subtasks) > 1:
            ui.label(
                "The demonstrations end in different ways: each goal is tried in turn until one is reached."
            ).classes("teach-landing")
        for number, one in enumerate(lesson.subtasks, start=1):
            names = ", ".join(lesson.demonstrations.demonstrations[d].name for d in one.subtask.demonstrations)
            heading("Goal" if len(lesson.subtasks) == 1 else f"Goal {number}, of {names}")
            with ui.element("ul").classes("lesson-list").props(f"data-testid=understand-goal-{number}"):
                for condition in one.subtask.goal:
                    with ui.element("li"):
                        ui.label(words.statement(condition)).props(f'title="{condition}"')
            sentences = [
                *order_sentences(lesson, one, say=lambda action: f"“{words(action)}”"),
                *precondition_sentences(one, say=functools.partial(_quoted, words)),
            ]
            if sentences:
                heading("Order")
                with ui.element("ul").classes("lesson-list").props(f"data-testid=understand-order-{number}"):
                    for sentence in sentences:
                        with ui.element("li"):
                            ui.label(sentence)

    async def _try_out(self) -> None:
        await self.studio.library.try_out()
        trial = self.studio.library.trial
        if trial is not None:
            self.page.say(f"{trial.sentence} All that was learnt is kept in {trial.folder}.", "success")

    def _download(self, kind: str) -> None:
        lesson = self.studio.library.lesson
        if lesson is None:
            raise UserError("nothing has been learnt yet; demonstrate in step 3")
        ui.download.content(FORMATS[kind](lesson.tree), f"learnt_tree.{kind}")
        self.page.say(f"The learnt tree is in your downloads, as learnt_tree.{kind}.", "success")

    def _run(self) -> None:
        studio, lesson = self.studio, self.studio.library.lesson
        if lesson is None:
            raise UserError("nothing has been learnt yet; demonstrate in step 3")
        studio.take_tree(lesson.tree, None)
        self.page.go("run")


def _quoted(words: Words, behavior: Behavior) -> str:
    return f"“{words.statement(behavior) if behavior.kind == Kind.CONDITION else words(behavior)}”"


def _agreement(candidate: Candidate | None) -> str:
    if candidate is None:
        return "not compared"
    if candidate.score == -math.inf:
        return "no agreement"
    return f"{candidate.size} within {length(max(candidate.spread, SPREAD_FLOOR))}"


def _reason(inference: Inference, lesson: Lesson) -> str:
    """Say why it is this frame, and how well the demonstrations agree in it."""
    said = inference.reason
    for frame in (*lesson.task.kit_names, lesson.task.robot_frame):
        said = re.sub(rf"\b{frame}\b", known(frame, lesson.task, robot="a fixed place"), said)
    said = re.sub(r"\bframe\b", "place", said)
    return f"{said[:1].upper()}{said[1:]}."
