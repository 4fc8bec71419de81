"""What all windows of the page show: the parts of the state, and what happens to several of them at once.

The state is changed on the event loop only. Each field belongs to one part; a change of several parts is announced once it
is complete.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from bt_jax._util.errors import UserError
from bt_jax.app.phrases import phrase
from bt_jax.app.processes.train_command import ANYWHERE, NO_CHANGES, Beginning
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.state.arrangement import fixed_layout
from bt_jax.app.state.bus import Bus, Kind
from bt_jax.app.state.correction import Correction
from bt_jax.app.state.demonstration_draft import DemonstrationDraft, DraftKeeper
from bt_jax.app.state.demonstration_library import DemonstrationLibrary
from bt_jax.app.state.edited_task import EditedTask, same_goal, same_things
from bt_jax.app.state.evolution_process import EvolutionProcess, EvolutionStage
from bt_jax.app.state.holds import Holds
from bt_jax.app.state.keeping import Keeping
from bt_jax.app.state.kit.complaints import complaints
from bt_jax.app.state.kit.starting import carried, first_start
from bt_jax.app.state.notices import Discard, Notice, Notices
from bt_jax.app.state.playing import Playing
from bt_jax.app.state.robot_twin import RobotTwin
from bt_jax.app.state.run_record import read_record, works
from bt_jax.app.state.teaching import Teaching
from bt_jax.app.state.watching import Watching
from bt_jax.app.state.worker import Worker
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.training.phases import Changes
from bt_jax.training.testing import episode_of_test

__all__ = ["Studio"]

KINDS: Mapping[EvolutionStage, Kind] = MappingProxyType(
    {"finished": "success", "failed": "error", "killed": "error", "vanished": "error"}
)


class Studio:
    """The parts: `edited` is the task of step 1, `evolution` the process that evolves, for a task of its own, `playing` the
    tree that is looked at, `correction` that tree while it is edited, `library` the demonstrations and what they teach,
    `teaching` the demonstration in the making, `watching` the camera that watches one, `keeping` what else lies in the
    folder, `robot` the robot's twin."""

    def __init__(
        self, workspace: Workspace, task: Task, warm_worker: WarmWorker | None = None, hold_factor: float = 1.0
    ) -> None:
        self.workspace = workspace
        self.bus, self.worker = Bus(), Worker()
        self.holds = Holds(self.bus, factor=hold_factor)
        self.keeping = Keeping(self.bus, self.worker, workspace)
        self.edited = EditedTask(workspace, task)
        self.evolution = EvolutionProcess(workspace, warm_worker)
        self.playing = Playing(self.bus, self.worker, self.edited)
        self.library = DemonstrationLibrary(self.bus, self.worker, workspace, self.edited)
        self.drafts = DraftKeeper(workspace, lambda error: self.bus.say(phrase(error, workspace.root), "error"))
        self.teaching = Teaching(self.bus, self.worker, self.edited, self.library, self.playing, self.drafts)
        self.watching = Watching(self.bus, workspace, self.edited, self.library)
        self.robot = RobotTwin(self.bus, self.worker, workspace, self.edited, self.playing)
        self.notices = Notices(self.bus)
        self.correction = Correction(self.bus, self.edited, self.playing)
        self.bus.subscribe("task", self.correction.try_again)
        self._restored: Notice | None = None  # stands until the draft that was restored is changed or saved
        self._kept_both: tuple[Task | None, Task] | None = None  # the two tasks that may differ
        self._following: Task | None = None  # the edited task that takes over what the evolution is taught

    def open_task(self, task: Task, start: World | None = None) -> None:
        """Edit another task, from the layout `start` or the first that is drawn. Raise UserError if a demonstration in the
        making would be lost."""
        self._check_not_teaching()
        self._open_task(task, start)
        self._keep_draft()

    def _open_task(self, task: Task, start: World | None = None) -> None:
        if not same_things(task, self.edited.task):
            self.correction.end()
            self.playing.take(None, None)
        self.edited.open(task, start)
        self.notices.remove(self._restored)
        self.playing.clear()
        self.teaching.task_opened()
        self.library.forget_lesson()
        self.bus.changed("task", "scene", "lesson", "player", "tree")

    def edit_task(self, task: Task, start: World | None = None) -> None:
        """Change the task; the tree and a demonstration in the making stay if all objects and kits do. Raise UserError if
        they do not and a demonstration in the making would be lost."""
        before = self.edited.task
        if not _same_scene(task, before):
            self._check_not_teaching()
        self.edited.edit(task, start)
        self._after_edit(before)

    def build(self, task: Task) -> None:
        """Change the objects or the kits of the task: what stays keeps its place at the start. Raise UserError as
        `edit_task`."""
        start = carried(self.edited.task, self.edited.start, task)
        self.edit_task(fixed_layout(task, start) if task.layout.fixed else task, start)

    def revert_task(self) -> None:
        """Take the task as its file says again; this can be undone, too. Raise UserError if the file has gone."""
        task = self.workspace.task(self.edited.task.name)
        self.edit_task(task, first_start(task))

    def discard_draft(self) -> None:
        """Take the task as its file says again or, if that has gone or is invalid, the first of the package. Raise
        UserError if a demonstration in the making would be lost."""
        try:
            self.workspace.task(self.edited.task.name)
        except UserError:
            self.open_task(self.workspace.task(self.workspace.task_names()[0]))
        else:
            self.revert_task()

    def undo_edit(self) -> None:
        """Take back the last edit of the task. Raise UserError if there is none, or as `edit_task`."""
        self._move(self.edited.undo, back=self.edited.redo)

    def redo_edit(self) -> None:
        """Repeat the edit that was taken back last. Raise UserError if there is none, or as `edit_task`."""
        self._move(self.edited.redo, back=self.edited.undo)

    def _move(self, step: Callable[[], None], *, back: Callable[[], None]) -> None:
        """Go to another version of the task, and back if that is not possible now."""
        before = self.edited.task
        step()
        try:
            if not _same_scene(self.edited.task, before):
                self._check_not_teaching()
        except UserError:
            back()
            raise
        self._after_edit(before)

    @property
    def unsaved(self) -> bool:
        """Whether the edited task equals neither its file nor the task of the run that is shown."""
        run, task = self.playing.run, self.edited.task
        return not self.edited.saved and (run is None or not self.workspace.run_holds(run, task))

    def restore(self) -> None:
        """Show the evolution that was running before this page, or else the newest run, and the drafts of the task
        and of a demonstration. The drafts stay on disk; one that cannot be restored is renamed, and the page says so."""
        name = self.evolution.find()
        if name is not None:
            with contextlib.suppress(UserError):
                self._open_run(name)
        try:
            draft = self.workspace.draft()
            if draft is not None and draft != self.edited.task:
                self._open_task(draft)
                self._restored = Notice(
                    f"Your unsaved changes of {draft.name} were restored; step 1 can save them.",
                    Discard(self.discard_draft, f"Discard the unsaved changes of {draft.name}?", steers="task"),
                )
                self.notices.add(self._restored)
        except UserError as error:
            self._set_aside("The draft of your task", error, self.workspace.set_draft_aside)
        self._restore_demonstration()

    def _restore_demonstration(self) -> None:
        """Go on with the demonstration that was in the making."""
        try:
            text = self.workspace.demonstration_draft()
            if text is None:
                return
            draft = DemonstrationDraft.from_json(text)
            session = draft.session(self.worker.physics(draft.task))
            if not same_things(draft.task, self.edited.task):
                if self.unsaved:
                    raise UserError(f"it is for {draft.task.name}, and step 1 has unsaved changes of another task")
                self._open_task(draft.task)
            self.teaching.restore(draft, session)
        except UserError as error:
            self._set_aside("The demonstration in the making", error, self.workspace.set_demonstration_draft_aside)
            return
        count = len(self.teaching.done)
        notice = Notice(
            f"The demonstration in the making was restored, with {count} action{'s' * (count > 1)}; step 3 goes on with it.",
            Discard(self.teaching.discard, "Discard this demonstration? Its actions will be lost.", steers="gripper"),
        )
        self.notices.add(notice)
        self.bus.subscribe(
            "demonstrations", lambda: None if self.teaching.draft is draft else self.notices.remove(notice)
        )

    def _set_aside(self, what: str, error: UserError, set_aside: Callable[[], Path]) -> None:
        """Keep a draft that cannot be restored, and say so."""
        try:
            kept = f"It is kept as {set_aside().name}."
        except UserError as other:
            kept = f"{phrase(other, self.workspace.root)}."
        self.notices.add(Notice(f"{what} cannot be restored: {phrase(error, self.workspace.root)}. {kept}"))

    def start_evolution(self, gp: GPConfig, begin: Beginning = ANYWHERE) -> None:
        """Evolve a tree for the edited task, in a new run folder. Raise UserError if an evolution is running, or the task
        cannot be done."""
        for complaint in complaints(self.edited.task):
            raise UserError(f"the task cannot be done yet, see step 1: {complaint.removesuffix('.')}")
        self.evolution.start(self.edited.task, gp, begin)
        self._following = self.edited.task
        self.playing.follow(None, self.evolution.run)
        self.bus.changed("evolution", "tree", "runs")
        self._keep_draft()

    def go_on(self, generations: int, changes: Changes = NO_CHANGES) -> None:
        """Evolve for more generations; with changes, in a new phase. Raise UserError if that is impossible."""
        goal = self.evolution.task if changes.task is None else changes.task
        self.evolution.go_on(generations, changes)
        self._following = self.edited.task if goal is not None and same_goal(goal, self.edited.task) else None
        self.playing.follow(self.playing.tree, self.evolution.run)
        self.bus.changed("evolution", "runs")
        self._keep_draft()

    def save_task(self, name: str) -> None:
        """Write the edited task to a file, whose name it has from now on. Raise UserError if that is impossible."""
        before = self.edited.task
        self.edited.save(name)
        self._after_edit(before)

    def take_goal(self, task: Task) -> None:
        """Give the edited task all that another says but its name and description; this can be undone. Raise UserError
        unless both have the same objects and frames."""
        edited = self.edited.task
        if not same_things(task, edited):
            raise UserError(f"{task.name} has other objects or kits than {edited.name}; open it in step 1")
        changed = dataclasses.replace(task, name=edited.name, description=edited.description)
        same_starts = (task.layout, task.tables, task.kits) == (edited.layout, edited.tables, edited.kits)
        self.edit_task(changed, None if same_starts else first_start(changed))

    @property
    def asks_for_goal(self) -> bool:
        """Whether the edited task and that of the evolution differ, and nobody has said that both should stay. While a
        training starts, its task is not known yet."""
        task = self.evolution.task
        if task is None or self.in_step or self.evolution.stage == "starting":
            return False
        return self._kept_both != (task, self.edited.task)

    def keep_both(self) -> None:
        """Let the edited task and that of the evolution differ until one of them changes."""
        self._kept_both = (self.evolution.task, self.edited.task)
        self.bus.changed("notices")

    @property
    def in_step(self) -> bool:
        """Whether the evolution works for what the edited task says."""
        return self.evolution.task is not None and same_goal(self.evolution.task, self.edited.task)

    def take_tree(self, tree: Tree | None, run: str | None) -> None:
        """Look at another tree, from a run or, with None, from elsewhere; whatever runs ends."""
        self.playing.take(tree, run)
        self.bus.changed("tree", "runs", "player")
        self._keep_draft()

    def open_run(self, name: str) -> None:
        """Show the task and the best tree of a run, and its evolution unless another is running. Raise UserError if the run
        has gone or cannot be read, or a demonstration in the making would be lost."""
        self._open_run(name)
        self._keep_draft()

    def _open_run(self, name: str) -> None:
        record = read_record(self.workspace.run(name))
        if record.config.task != self.edited.task:
            self._check_not_teaching()
            self._open_task(record.config.task)
        if not self.evolution.running:
            self.evolution.open(name)
        self.playing.take(record.tree, name)
        self.bus.changed("tree", "runs", "player", "evolution")

    async def replay(self, run: str, layout: int, draw: int = 1) -> None:
        """Open a run and let its tree begin where one of the episodes of its test has, with what went wrong there; layouts
        and draws are numbered from 1. Raise UserError as `open_run` does, or if there was no such episode."""
        config = self.workspace.run(run).config()
        start, fate = await self.worker.work(episode_of_test, config.task, config, layout, draw)
        self.open_run(run)
        await self.playing.begin(start, fate)

    async def delete_run(self, name: str) -> None:
        """Move a run into the trash; its tree may still be looked at, and its task stays in step 1. Raise UserError, and
        move nothing, if the run has gone, a process is training there, or a task that only this run holds cannot be kept as
        the draft."""
        if self.playing.run == name and not self.edited.saved:
            self.workspace.save_draft(self.edited.task)
        await self.keeping.put_away("run", name)
        self.evolution.forget(name)
        self.playing.forget_run(name)
        self.bus.changed("runs", "evolution", "tree")
        self._keep_draft()

    async def delete_task(self, name: str) -> None:
        """Move the file of a task into the trash; if it is the edited one, it stays in step 1, unsaved. Raise UserError, and
        move nothing, if it has gone, comes with the package, or cannot be kept as the draft."""
        if self.edited.task.name == name:
            self.workspace.save_draft(self.edited.task)
        await self.keeping.put_away("task", name)
        self._keep_draft()

    def watch(self) -> None:
        """Follow the evolution; to be called a few times a second."""
        evolution = self.evolution
        before, gone = evolution.stage, evolution.gone
        if not evolution.poll():
            return
        shown = self.playing.run == evolution.run
        if shown and evolution.tree is not None and evolution.tree != self.playing.tree:
            self.playing.follow(evolution.tree, evolution.run)
            self.bus.changed("tree")
        another = (evolution.stage, evolution.gone) != (before, gone)
        if another:
            kind = KINDS.get(evolution.stage, "info")
            fails = evolution.result is not None and not works(evolution.result)
            self.bus.say(evolution.sentence, "warning" if fails else kind)
            self.bus.changed("runs")
        self.bus.changed("evolution")
        try:
            if shown and before == "starting" != evolution.stage:
                self._follow()
            if another:
                self._keep_draft()
        except UserError as error:
            self.bus.say(phrase(error, self.workspace.root), "error")

    def _check_not_teaching(self) -> None:
        if self.teaching.busy:
            raise UserError("a demonstration is in the making; finish or discard it in step 3 first")

    def _follow(self) -> None:
        """Take over the targets that the evolution was taught, unless a person has edited the task since."""
        task, following, self._following = self.evolution.task, self._following, None
        if task is None or following is None or following is not self.edited.task or not self.evolution.running:
            return
        taught = dataclasses.replace(following, targets=task.targets, subgoals=task.subgoals)
        if taught != following:
            self.edit_task(taught)

    def _after_edit(self, before: Task) -> None:
        task = self.edited.task
        self.notices.remove(self._restored)
        if not same_things(task, before):
            self.playing.take(None, None)
            self.library.forget_lesson()
        self.playing.clear()
        if _same_scene(task, before):
            self.teaching.task_edited()
        else:
            self.teaching.task_opened()
        self.bus.changed("task", "scene", "player")
        if not same_things(task, before):
            self.bus.changed("lesson", "tree")
        self._keep_draft()

    def _keep_draft(self) -> None:
        """Keep on disk what no other file holds. Raise UserError if that fails; the change itself is made by then."""
        if self.unsaved:
            self.workspace.save_draft(self.edited.task)
        else:
            self.notices.remove(self._restored)
            self.workspace.delete_draft()


def _same_scene(one: Task, other: Task) -> bool:
    """Whether two tasks look alike but for targets and starts, so that a demonstration in the making can go on."""
    return same_things(one, other) and (one.kits, one.tables) == (other.kits, other.tables)
