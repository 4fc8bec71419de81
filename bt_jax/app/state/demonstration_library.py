"""The demonstrations that are kept, and what is learnt from them."""

from __future__ import annotations

import asyncio
import dataclasses
from typing import TYPE_CHECKING

from bt_jax._util.errors import UserError
from bt_jax.app.processes.trial import Trial, try_out
from bt_jax.app.state.replay import handled
from bt_jax.lfd import DemonstrationFolder, Lesson
from bt_jax.lfd.clustering import NEEDED
from bt_jax.tasks import Task
from bt_jax.training.phases import choose_frames, lesson_from

if TYPE_CHECKING:
    from bt_jax.app.state.studio import Studio

__all__ = ["DemonstrationLibrary", "Kept"]


@dataclasses.dataclass(frozen=True)
class Kept:
    """A demonstration in the list: its name, what it does, and why it cannot be used, if so."""

    name: str
    summary: str
    problem: str = ""


class DemonstrationLibrary:
    """`kept` are the demonstrations of the chosen set, `studio.lesson` is what they teach for the task, and `problem` why
    they teach nothing; `trial` is how often the tree that was learnt works. All windows hear of changes."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.read = False  # whether `kept` has been read at all
        self.kept: tuple[Kept, ...] = ()
        self.problem = ""
        self.trial: Trial | None = None
        self.trying = False
        self._reading = asyncio.Lock()
        self._refreshing: asyncio.Task | None = None
        studio.subscribe("task", self._task_changed)

    @property
    def folder(self) -> DemonstrationFolder:
        """The set of demonstrations. Raises UserError where its name leads out of the workspace."""
        return self.studio.workspace.demonstration_set(self.studio.demonstration_set)

    @property
    def progress(self) -> str:
        """How many demonstrations there are and how many are needed, in a sentence."""
        if not self.read:
            return "The demonstrations are being read."
        count = sum(not one.problem for one in self.kept)
        if count == 0:
            return f"No demonstration yet; {NEEDED} are needed to tell what each place is relative to."
        if count < NEEDED:
            return (
                f"{count} of {NEEDED} demonstrations: {NEEDED - count} more will tell what each place is relative to."
            )
        return f"{count} demonstrations: enough to tell what each place is relative to."

    async def use_set(self, name: str) -> None:
        """Another set of demonstrations, there already or not."""
        self.studio.workspace.demonstration_set(name)
        self.studio.demonstration_set = name
        self.read, self.kept = False, ()
        self.studio.changed("demonstrations")
        await self.refresh()

    async def rename(self, name: str, new: str) -> None:
        """Gives a demonstration another name."""
        await self.studio.work(self.folder.rename, name, new.strip())
        await self.refresh()

    async def delete(self, name: str) -> None:
        """Removes a demonstration for good."""
        await self.studio.work(self.folder.delete, name)
        await self.refresh()

    async def choose_frame(self, index: int, frame: str | None) -> None:
        """The frame of an inference as a person says, None for what the demonstrations say; the tree is learnt anew."""
        lesson = self.studio.lesson
        if lesson is None:
            raise UserError("nothing has been learnt yet; give demonstrations in step 3")
        try:
            await self.studio.work(choose_frames, self.folder.path, lesson, {index: frame})
        finally:
            await self.refresh()

    async def refresh(self) -> None:
        """Reads the set again and learns from it."""
        async with self._reading:
            studio, folder, task = self.studio, self.folder, self.studio.task
            kept, lesson, problem = await studio.work(_learnt, folder, task)
            if (studio.task, self.folder) != (task, folder):
                return  # another one was chosen meanwhile, and is read next
            same = self.read and (kept, lesson, problem) == (self.kept, studio.lesson, self.problem)
            self.read, self.kept, studio.lesson, self.problem = True, kept, lesson, problem
        if not same:
            self.trial = None
            studio.changed("demonstrations", "lesson")

    async def try_out(self) -> None:
        """Finds out how often the learnt tree works, in a process of its own."""
        studio, lesson = self.studio, self.studio.lesson
        if lesson is None:
            raise UserError("nothing has been learnt yet; give demonstrations in step 3")
        if self.trying:
            raise UserError("the tree is being tried already; wait for what comes of it")
        self.trying = True
        studio.changed("lesson")
        try:
            trial = await try_out(self.folder.path, lesson.task, studio.workspace.runs)
            self.trial = trial if studio.lesson is lesson or studio.lesson == lesson else None
        finally:
            self.trying = False
            studio.changed("lesson", "runs")

    def _task_changed(self) -> None:
        """What is learnt depends on the task."""
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return  # before the server runs; the first window reads the set
        self._refreshing = loop.create_task(self.refresh())


def _kept(folder: DemonstrationFolder) -> tuple[Kept, ...]:
    """The demonstrations of a set in their order, those that cannot be used among them."""
    if not (folder.path / "info.yaml").is_file():
        return ()
    good, problems = {}, ()
    try:
        read = folder.read()
        good, problems = {one.name: one for one in read}, read.problems
    except UserError as error:
        problems = (str(error),)
    found = []
    for name in folder.names():
        if name in good:
            things = handled(good[name], read.frames)
            found.append(Kept(name, ", then ".join(things[::2])))
        else:
            why = next(
                (problem for problem in problems if f"{name} is" in problem or f"{name}/" in problem),
                problems[0] if problems else "",
            )
            found.append(Kept(name, "cannot be used", why))
    return tuple(found)


def _learnt(folder: DemonstrationFolder, task: Task) -> tuple[tuple[Kept, ...], Lesson | None, str]:
    """The demonstrations of a set, what they teach for a task, and why they teach nothing."""
    kept = _kept(folder)
    try:
        return kept, lesson_from(folder.path, task) if kept else None, ""
    except UserError as error:
        return kept, None, str(error)
