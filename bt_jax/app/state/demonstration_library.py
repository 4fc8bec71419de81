"""The demonstrations that are kept, and what is learnt from them."""

from __future__ import annotations

import asyncio
import dataclasses
from collections.abc import Callable
from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.answer_pictures import answer_pictures
from bt_jax.app.processes.trial import Trial, try_out
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.edited_task import EditedTask
from bt_jax.app.state.replay import handled
from bt_jax.app.state.trash import Trash
from bt_jax.app.state.worker import Worker
from bt_jax.app.state.workspace import Workspace
from bt_jax.lfd import (
    Answer,
    Corrections,
    DemonstrationFolder,
    Demonstrations,
    Lesson,
    Proposal,
    Question,
    open_questions,
    propose,
)
from bt_jax.lfd.clustering import NEEDED
from bt_jax.lfd.disagreement import Disagreement, disagreements
from bt_jax.lfd.questions import Answered
from bt_jax.tasks import Task
from bt_jax.training.phases import choose_frames, lesson_from

__all__ = ["Asked", "DemonstrationLibrary", "ListedDemonstration"]

FIRST_SET = "demonstrations"


@dataclasses.dataclass(frozen=True)
class ListedDemonstration:
    """A demonstration in the list: its name, what it moves, why it cannot be used, empty if it can, and whether it is left
    out."""

    name: str
    summary: str
    problem: str = ""
    left_out: bool = False

    @property
    def counts(self) -> bool:
        """Whether something is learnt from it."""
        return not (self.problem or self.left_out)


@dataclasses.dataclass(frozen=True)
class Asked:
    """What is open in a lesson, and the addresses of a picture of each answer to each question, none where none can be
    drawn."""

    questions: tuple[Question, ...]
    pictures: tuple[tuple[str, ...], ...]


class DemonstrationLibrary:
    """`kept` are the demonstrations of the set with the name `set_name`, `lesson` is what they teach for the edited task,
    `problem` why they teach nothing, `asked` what they leave open, None while that is not known; `trial` is how often the
    tree that was learnt works."""

    def __init__(self, bus: Bus, worker: Worker, workspace: Workspace, edited: EditedTask) -> None:
        self.set_name = FIRST_SET
        self.read = False  # whether `kept` has been read at all
        self.kept: tuple[ListedDemonstration, ...] = ()
        self.lesson: Lesson | None = None
        self.problem = ""
        self.asked: Asked | None = None
        self.trial: Trial | None = None
        self.trying = False
        self._bus, self._worker, self._workspace, self._edited = bus, worker, workspace, edited
        self._trash = Trash(workspace)
        self._reading = asyncio.Lock()
        self._asking: Lesson | None = None  # of which it is being found out what is open
        self._refreshing: asyncio.Task | None = None
        bus.subscribe("task", self._learn_again)

    @property
    def folder(self) -> DemonstrationFolder:
        """The set of demonstrations. Raise UserError if its name leads out of the workspace."""
        return self._workspace.demonstration_set(self.set_name)

    @property
    def progress(self) -> str:
        """How many demonstrations there are and how many are needed, in a sentence."""
        if not self.read:
            return "The demonstrations are being read."
        count = sum(one.counts for one in self.kept)
        if count == 0:
            return f"No demonstration yet; {NEEDED} are needed to tell what each place is relative to."
        if count < NEEDED:
            return (
                f"{count} of {NEEDED} demonstrations: {NEEDED - count} more will tell what each place is relative to."
            )
        return f"{count} demonstrations: enough to tell what each place is relative to."

    async def use_set(self, name: str) -> None:
        """Use another set of demonstrations, which may not exist yet."""
        self._workspace.demonstration_set(name)
        self.set_name = name
        self.read, self.kept = False, ()
        self._bus.changed("demonstrations")
        await self.refresh()

    def restore_set(self, name: str) -> DemonstrationFolder:
        """Use a set of demonstrations before anything is read. Raise UserError if its name leads out of the workspace."""
        folder = self._workspace.demonstration_set(name)
        self.set_name = name
        return folder

    async def rename(self, name: str, new: str) -> None:
        """Give a demonstration another name."""
        await self._worker.work(self.folder.rename, name, new.strip())
        await self.refresh()

    async def delete(self, name: str) -> None:
        """Move a demonstration into the trash. Raise UserError if it has gone."""
        await self._worker.work(self._trash.put, "demonstration", name, self.set_name)
        self._bus.changed("trash")
        await self.refresh()

    async def leave_out(self, name: str, left_out: bool) -> None:
        """Learn nothing from a demonstration from now on, or take it in again."""
        await self._worker.work(self.folder.leave_out, name, left_out)
        await self.refresh()

    @property
    def disagreements(self) -> tuple[Disagreement, ...]:
        """Which demonstrations disagree with most of the others."""
        return () if self.lesson is None else disagreements(self.lesson)

    async def choose_frame(self, index: int, frame: str | None) -> None:
        """Set the frame of an inference, None for the one that the demonstrations suggest, and learn again."""
        lesson = self._known()
        try:
            await self._worker.work(choose_frames, self.folder.path, lesson, {index: frame})
        finally:
            await self.refresh()

    async def refresh(self) -> None:
        """Read the set again and learn from it."""
        async with self._reading:
            folder, task = self.folder, self._edited.task
            kept, lesson, problem = await self._worker.work(_learnt, folder, task, self._workspace.root)
            if (self._edited.task, self.folder) != (task, folder):
                return  # another one was chosen meanwhile, and is read next
            same = self.read and (kept, lesson, problem) == (self.kept, self.lesson, self.problem)
            self.read, self.kept, self.lesson, self.problem = True, kept, lesson, problem
        if not same:
            self.trial = self.asked = None
            self._bus.changed("demonstrations", "lesson")

    async def ask(self) -> None:
        """Find out what is open in the lesson, once, beside what else is done."""
        lesson = self.lesson
        if lesson is None or self.asked is not None or self._asking is lesson:
            return
        self._asking = lesson
        try:
            asked = await asyncio.to_thread(_asked, lesson)
            if self.lesson is lesson:
                self.asked = asked
                self._bus.changed("lesson")
        finally:
            self._asking = None if self._asking is lesson else self._asking

    async def answer(self, answer: Answer) -> None:
        """Keep an answer to a question about the lesson, and learn again."""
        await self._correct(self.folder.correct, answer.corrections)

    async def take_back(self, said: Answered) -> None:
        """Keep an answer no longer, and learn again."""
        await self._correct(self.folder.take_back, said.corrections)

    async def _correct(self, change: Callable[[Demonstrations, Corrections], None], corrections: Corrections) -> None:
        lesson = self._known()
        try:
            await self._worker.work(change, lesson.demonstrations, corrections)
        finally:
            await self.refresh()

    async def propose(self) -> Proposal:
        """Return the start of the demonstration that settles most of what is open. Raise UserError if nothing is."""
        lesson, asked = self._known(), self.asked
        return await asyncio.to_thread(propose, lesson, () if asked is None else asked.questions)

    def _known(self) -> Lesson:
        """Return the lesson. Raise UserError if there is none."""
        if self.lesson is None:
            raise UserError("nothing has been learnt yet; give demonstrations in step 3")
        return self.lesson

    def forget_lesson(self) -> None:
        """Drop what was learnt for a task that is no longer edited."""
        self.lesson = self.asked = None

    async def try_out(self) -> None:
        """Measure how often the learnt tree works, in a process of its own."""
        lesson = self._known()
        if self.trying:
            raise UserError("the tree is being tried already; wait for the result")
        self.trying = True
        self._bus.changed("lesson")
        try:
            trial = await try_out(self.folder.path, lesson.task, self._workspace.runs)
            self.trial = trial if self.lesson == lesson else None
        finally:
            self.trying = False
            self._bus.changed("lesson", "runs")

    def _learn_again(self) -> None:
        """Learn for the task as it is now."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return  # before the server runs; the first window reads the set
        self._refreshing = loop.create_task(self.refresh())


def _listed(folder: DemonstrationFolder, root: Path) -> tuple[ListedDemonstration, ...]:
    """Return the demonstrations of a set in their order, unusable ones included."""
    if not (folder.path / "info.yaml").is_file():
        return ()
    moved: dict[str, str] = {}
    left_out = folder.left_out()
    problems: tuple[str, ...] = ()
    try:
        read = folder.read()
        moved = {one.name: ", then ".join(handled(one, read.frames)[::2]) for one in read}
        problems = read.problems
    except UserError as error:
        problems = (str(error),)
    problems = tuple(phrase(problem, root) for problem in problems)
    found = []
    for name in folder.names():
        if name in left_out:
            found.append(ListedDemonstration(name, "left out: nothing is learnt from it", left_out=True))
        elif name in moved:
            found.append(ListedDemonstration(name, moved[name]))
        else:
            why = next(
                (problem for problem in problems if f"{name} is" in problem or f"{name}/" in problem),
                problems[0] if problems else "",
            )
            found.append(ListedDemonstration(name, "cannot be used", why))
    return tuple(found)


def _learnt(
    folder: DemonstrationFolder, task: Task, root: Path
) -> tuple[tuple[ListedDemonstration, ...], Lesson | None, str]:
    """Return the demonstrations of a set, what they teach for a task, and why they teach nothing; `root` is the page's
    folder."""
    kept = _listed(folder, root)
    try:
        learns = any(not one.left_out for one in kept)
        return kept, (lesson_from(folder.path, task) if learns else None), ""
    except UserError as error:
        return kept, None, phrase(error, root)


def _asked(lesson: Lesson) -> Asked:
    questions = open_questions(lesson)
    return Asked(questions, answer_pictures(questions, lesson.task))
