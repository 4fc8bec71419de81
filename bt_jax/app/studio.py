"""What all windows of the page show: one task, one scene, one evolution, one demonstration in the making.

The state is changed on the event loop only; `changed` tells every window. What takes longer than a blink is given to
`work`, one thing at a time, in a thread beside the loop.
"""

from __future__ import annotations

import asyncio
import dataclasses
import traceback
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Literal, ParamSpec, TypeVar

from bt_jax.app.evolution import Evolution
from bt_jax.app.playing import Playing
from bt_jax.app.teaching import Teaching
from bt_jax.app.workspace import Workspace
from bt_jax.behaviors import Tree
from bt_jax.errors import UserError
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Lesson
from bt_jax.mjx_env.layouts import sample_layouts
from bt_jax.mjx_env.mujoco_backend import MujocoPhysics
from bt_jax.mjx_env.physics import Physics
from bt_jax.mjx_env.statuses import see_subgoals
from bt_jax.mjx_env.world import World
from bt_jax.task import Task
from bt_jax.teleoperation import Teleoperation

if TYPE_CHECKING:
    from bt_jax.app.player import Player

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

    def __init__(self, workspace: Workspace, task: Task) -> None:
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
        self._physics: Physics | None = None
        self.gp = GPConfig()  # of the next evolution
        self.evolution = Evolution(workspace)
        self.message = ""
        self._listeners: dict[Topic, list[Callable[[], None]]] = defaultdict(list)
        self._worker = ThreadPoolExecutor(max_workers=1, thread_name_prefix="studio")
        self.teaching = Teaching(self)

    def set_task(self, task: Task, start: World | None = None) -> None:
        """Another task: the scene begins anew, in a layout of one's own or the first that is drawn. Raises UserError where
        that would lose a demonstration in the making."""
        if self.session is not None and self.session.actions:
            raise UserError("a demonstration is in the making; finish or discard it in step 3 first")
        self.task = task
        self.start = self.shown = sample_layouts(task, 0, 1) if start is None else start
        self.session = self.player = self.lesson = None
        self.changed("task", "scene", "lesson", "player")

    def amend(self, task: Task, start: World | None = None) -> None:
        """The task with other targets or another beginning, but the same things in the scene, which stays as it is unless
        there is another `start`."""
        self.task = task
        self.start, self.shown = (
            dataclasses.replace(world, reached=see_subgoals(task, world))
            for world in ((self.start, self.shown) if start is None else (start, start))
        )
        self.player = None
        self.changed("task", "scene", "player")

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

    def open_run(self, name: str) -> None:
        """Shows the task and the best tree of a run, and its evolution unless another is running. Raises UserError where the
        run has gone or cannot be read."""
        folder = self.workspace.run(name)
        task, tree = folder.config().task, folder.tree()
        if task != self.task:
            self.set_task(task)
        if not self.evolution.running:
            self.evolution.open(name)
        self.run, self.tree = name, tree
        self.changed("tree", "runs", "evolution")

    def find_evolution(self) -> None:
        """Shows the evolution that was going on before this page, if there is one."""
        name = self.evolution.find()
        if name is not None:
            self.evolution.open(name)
            self.run, self.tree, self.task = name, self.evolution.tree, self.workspace.run(name).config().task
            self.start = self.shown = sample_layouts(self.task, 0, 1)

    def watch(self) -> None:
        """Looks after the evolution; to be called a few times a second."""
        before = self.evolution.stage
        if not self.evolution.poll():
            return
        if self.run == self.evolution.run:
            self._follow(started=before == "starting" != self.evolution.stage)
        if self.evolution.stage != before:
            self.say(self.evolution.sentence)
            self.changed("runs")
        self.changed("evolution")

    def _follow(self, *, started: bool) -> None:
        """The tree to look at is the best of the evolution, and the task is what it evolves for."""
        if self.evolution.tree is not None and self.evolution.tree != self.tree:
            self.tree = self.evolution.tree
            self.changed("tree")
        if started and self.evolution.running:
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
