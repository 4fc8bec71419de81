"""What the demonstrations leave open, in step 4: questions with a picture of each answer, and what a person has answered."""

from __future__ import annotations

import functools

from nicegui import ui

from bt_jax.app.panels.parts import button, heading, mark
from bt_jax.app.state.studio import Studio
from bt_jax.app.widgets.context import PageContext
from bt_jax.lfd import Answer, Lesson, Question
from bt_jax.lfd.question_words import answer_words, answered_words, question_words, start_words
from bt_jax.lfd.questions import Answered, answered

__all__ = ["Questions"]

SETTLE = "Arrange the start for the demonstration that settles this"
HINT = "Or show it once more, from a start in which the answers lead to different places."


class Questions:
    """A part of a panel that shows the questions of the lesson, as soon as they are known."""

    def __init__(self, studio: Studio, page: PageContext) -> None:
        self.studio, self.page, self.library = studio, page, studio.library
        self.area = ui.element("div").classes("teach")
        page.on("lesson", self._refresh)
        page.on("lesson", studio.library.ask)

    def _refresh(self) -> None:
        lesson, asked = self.library.lesson, self.library.asked
        self.area.clear()
        if lesson is None:
            return
        with self.area:
            if asked is None:
                self._say("Looking for what is still open.", "understand-asking")
            elif asked.questions:
                heading("Questions")
                for number, question in enumerate(asked.questions, start=1):
                    pictures = asked.pictures[number - 1]
                    self._question(lesson, number, question, pictures)
                propose = self.page.guard(self._propose, steers="gripper")
                button(SETTLE, "understand-propose", "back_hand", propose, more="outline")
                ui.label(HINT).classes("teach-hint")
            elif not lesson.missing:
                self._say(
                    "Nothing is open: there is only one way to understand what you have shown.", "understand-clear"
                )
            said = answered(lesson)
            if said:
                heading("Your answers")
                for number, one in enumerate(said, start=1):
                    self._answered(lesson, number, one)

    def _say(self, text: str, testid: str) -> None:
        mark(ui.label(text).classes("teach-hint"), testid)

    def _question(self, lesson: Lesson, number: int, question: Question, pictures: tuple[str, ...]) -> None:
        text = question_words(question, lesson)
        card = ui.element("div").classes("lesson-question").props("role=group")
        with mark(card, f"understand-question-{number}", aria_label=text):
            ui.label(text).classes("text-bold")
            with ui.element("div").classes("lesson-answers"):
                for nth, answer in enumerate(question.answers, start=1):
                    self._answer(lesson, f"{number}-{nth}", question, answer, pictures[nth - 1 : nth], taken=nth == 1)

    def _answer(
        self, lesson: Lesson, numbers: str, question: Question, answer: Answer, picture: tuple[str, ...], *, taken: bool
    ) -> None:
        words = answer_words(question.kind, answer.value, lesson)
        card = ui.element("button").classes("lesson-answer").props("type=button")
        card.on("click", self.page.guard(functools.partial(self._choose, answer, words)))
        with mark(card, f"understand-answer-{numbers}"):
            for address in picture:
                mark(ui.element("img"), f"understand-picture-{numbers}", src=address, alt="")
            ui.label(words)
            if taken:
                ui.label("taken until you answer").classes("teach-hint")

    def _answered(self, lesson: Lesson, number: int, said: Answered) -> None:
        with ui.row().classes("items-center gap-2 no-wrap"):
            mark(ui.label(answered_words(said, lesson)).classes("flex-1"), f"understand-answered-{number}")
            back = self.page.guard(functools.partial(self._take_back, said))
            button("Take back", f"understand-take-back-{number}", "undo", back, more="flat")

    async def _choose(self, answer: Answer, words: str) -> None:
        await self.library.answer(answer)
        self.page.say(f"“{words}” is kept, and the tree is learnt again.", "success")

    async def _take_back(self, said: Answered) -> None:
        await self.library.take_back(said)
        self.page.say("The answer is taken back, and the tree is learnt again.", "success")

    async def _propose(self) -> None:
        proposal = await self.library.propose()
        await self.studio.teaching.begin(reached=False, start=proposal.start)
        self.page.go("demonstrate")
        self.page.say(f"{start_words(proposal.start, proposal.task)} It is arranged so; show the same once more.")
