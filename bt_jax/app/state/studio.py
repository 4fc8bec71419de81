"""What all windows of the page show: one task, one scene, one evolution, one demonstration in the making.

The state is changed on the event loop only; `changed` tells every window. What takes longer than a blink is given to
`work`, one thing at a time, in a thread beside the loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import traceback
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Literal, ParamSpec, TypeVar

from bt_jax._util.errors import UserError
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.app.state.demonstration_library import DemonstrationLibrary
from bt_jax.app.state.evolution import Evolution
from bt_jax.app.state.playing import Playing
from bt_jax.app.state.record import read_record
from bt_jax.app.state.teaching import Teaching
from bt_jax.app.state.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Lesson
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import see_subgoals
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.teleoperation import Teleoperation

if TYPE_CHECKING:
    from bt_jax.app.state.player import Player

__all__ = ["Studio", "Topic"]

Topic = Literal["task", "scene", "evolution", "tree", "demonstrations", "lesson", "player", "runs", "message"]
P = ParamSpec("P")
T = TypeVar("T")


class Studio:
    """The state behind the page.

    `start` is the layout in which things begin, `shown` what the scene shows; both are batches of one state (NumPy).
    `tree` is the tree to look at and to run, `run` the name of the run folder that it came from. Whoever changes something
    here says so with `changed`.
    """

    def __init__(self, workspace: Workspace, task: Task, reserve: WarmWorker | None = None) -> None:
        self.workspace, self.task = workspace, task
        self.start: World = sample_layouts(task, 0, 1)
        self.shown: World = self.start
        self.run: str | None = None
        self.tree: Tree | None = None
        self.demonstration_set = "demonstrations"
        self.lesson: Lesson | None = None
        self.session: Teleoperation | None = None
        self.player: Player | None = None
        self.playing = Playing(self)
        self.turn = asyncio.Lock()  # for changes that are computed from the task and the scene, one after the other
        self._physics: Physics | None = None
        self._launched: Task | None = None  # the task as it was when the evolution was started
        self.gp = GPConfig()  # of the next evolution
        self.evolution = Evolution(workspace, reserve)
        self.message = ""
        self._listeners: dict[Topic, list[Callable[[], None]]] = defaultdict(list)
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="studio")
        self.shelf = DemonstrationLibrary(self)
        self.teaching = Teaching(self)

    def set_task(self, task: Task, start: World | None = None) -> None:
        """Another task: the scene begins anew, in a layout of one's own or the first that is drawn. Raises UserError where
        that would lose a demonstration in the making."""
        if self.session is not None and self.session.actions:
            raise UserError("a demonstration is in the making; finish or discard it in step 3 first")
        start = sample_layouts(task, 0, 1) if start is None else start
        if (task.boxes, task.frames) != (self.task.boxes, self.task.frames):
            self.run = self.tree = None
        self.task, self.start, self.shown = task, start, start
        self.session = self.player = self.lesson = None
        self.changed("task", "scene", "lesson", "player", "tree")

    def amend(self, task: Task, start: World | None = None) -> None:
        """The task with other targets or another beginning, but the same things in the scene, which stays as it is unless
        there is another `start`; a demonstration in the making goes on where it is."""
        shown = self.shown if start is None or self.session is not None else start
        worlds = [self.start if start is None else start, shown]
        worlds = [dataclasses.replace(world, reached=see_subgoals(task, world)) for world in worlds]
        self.task, (self.start, self.shown), self.player = task, worlds, None
        self.changed("task", "scene", "player")

    @property
    def saved(self) -> bool:
        """Whether the task is as its file says."""
        with contextlib.suppress(UserError):
            return self.workspace.task(self.task.name) == self.task
        return False

    @property
    def unsaved(self) -> bool:
        """Whether the task is neither as its file says, nor that of the run that is shown."""
        if self.saved:
            return False
        with contextlib.suppress(UserError):
            return self.run is None or self.workspace.run(self.run).config().task != self.task
        return True

    @property
    def physics(self) -> Physics:
        """The C engine, which starts at once, for the task; to be used in `work` only."""
        if self._physics is None or self._physics.task is not self.task:
            self._physics = MujocoPhysics(self.task, threads=1, why="one scene at a time")
        return self._physics

    def start_evolution(self, gp: GPConfig) -> None:
        """Evolves a tree for the task, in a new run folder. Raises UserError where one is running."""
        self.evolution.start(self.task, gp)
        self.gp, self.run, self.tree = gp, self.evolution.run, None
        self.changed("evolution", "tree", "runs")

    def take(self, tree: Tree | None, run: str | None) -> None:
        """Another tree to look at and to run, with the run that it is from, None where it is from none; what runs ends."""
        self.playing.halt()
        self.tree, self.run, self.player = tree, run, None
        self.changed("tree", "runs", "player")

    def open_run(self, name: str) -> None:
        """Shows the task and the best tree of a run, and its evolution unless another is running. Raises UserError where the
        run has gone or cannot be read."""
        record = read_record(self.workspace.run(name))
        if record.config.task != self.task:
            self.set_task(record.config.task)
        if not self.evolution.running:
            self.evolution.open(name)
        self.take(record.tree, name)
        self.changed("evolution")

    def forget_run(self, name: str) -> None:
        """A run was deleted; its tree may still be looked at."""
        self.evolution.forget(name)
        if self.run == name:
            self.run = None
        self.changed("runs", "evolution", "tree")

    def find_evolution(self) -> None:
        """Shows the evolution that was going on before this page, or else the newest run."""
        name = self.evolution.find()
        if name is not None:
            with contextlib.suppress(UserError):
                self.open_run(name)

    def watch(self) -> None:
        """Looks after the evolution; to be called a few times a second."""
        before, gone = self.evolution.stage, self.evolution.gone
        if before != "starting":
            self._launched = None
        elif self._launched is None:
            self._launched = self.task
        if not self.evolution.poll():
            return
        if self.run == self.evolution.run:
            self._follow(started=before == "starting" != self.evolution.stage)
        if (self.evolution.stage, self.evolution.gone) != (before, gone):
            self.say(self.evolution.sentence)
            self.changed("runs")
        self.changed("evolution")

    def _follow(self, *, started: bool) -> None:
        """The tree to look at is the best of the evolution, and the task is what it evolves for."""
        if self.evolution.tree is not None and self.evolution.tree != self.tree:
            self.tree = self.evolution.tree
            self.changed("tree")
        if not started:
            return
        launched, self._launched = self._launched, None
        if (
            self.evolution.running and self.task is launched
        ):  # else a person has changed it since, and goes on with that
            task = self.workspace.run(self.run).config().task
            if task != self.task:
                self.amend(task)

    def show(self, world: World) -> None:
        """The scene shows this state."""
        self.shown = world
        self.changed("scene")

    def say(self, message: str) -> None:
        """One sentence for the footer of every window."""
        self.message = message
        self.changed("message")

    def subscribe(self, topic: Topic, callback: Callable[[], None]) -> Callable[[], None]:
        """Calls back after each change; the function that is returned ends that."""
        self._listeners[topic].append(callback)
        return lambda: self._listeners[topic].remove(callback)

    def changed(self, *topics: Topic) -> None:
        """Tells all who listen; one that fails does not keep it from the others."""
        for topic in topics:
            for callback in list(self._listeners[topic]):
                try:
                    callback()
                except Exception:
                    traceback.print_exc()

    async def work(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Runs a function in the one worker thread, after what was given to it before, and returns what it returns."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._worker, lambda: function(*args, **kwargs))
