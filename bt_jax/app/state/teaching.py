"""Between the buttons and a demonstration: the gripper under a person's control, and what was demonstrated shown again.

One demonstration is in the making at a time, in `studio.session`; all windows show it. Inputs are carried out one after the
other, in the order in which they come. An input that raises UserError has changed nothing.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.app.state.replay import Scene, described, scenes
from bt_jax.behaviors import Tree
from bt_jax.lfd import Frames
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.script import DEMONSTRATED, reached_by
from bt_jax.teaching.teleoperation import Landing, Teleoperation

if TYPE_CHECKING:
    from bt_jax.app.state.studio import Studio

__all__ = ["DIRECTIONS", "Direction", "Teaching"]

Direction = Literal["left", "right", "away", "near", "up", "down"]
DIRECTIONS: tuple[Direction, ...] = ("left", "right", "away", "near", "up", "down")
STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # metres, for the keys + and -
FIRST_STEP = 0.02
OVER = 1.5  # how high the held object is carried over another, in its sizes
PACE = 0.9  # seconds for which each scene of a replay is shown


class Teaching:
    """`step` is how far a key moves the gripper [m]; with `elsewhere`, each demonstration begins in another layout.
    `replayed` is the name of what is being replayed."""

    def __init__(self, studio: Studio) -> None:
        self.studio = studio
        self.step = FIRST_STEP
        self.elsewhere = True
        self.replayed: str | None = None
        self._replay: asyncio.Task | None = None
        self._lock = asyncio.Lock()
        self._layout = 0  # number of the next random layout
        studio.subscribe("task", self.stop_replay)

    @property
    def session(self) -> Teleoperation:
        """The demonstration in the making. Raises UserError where there is none."""
        if self.studio.session is None:
            raise UserError("no demonstration is in the making; begin a new one first")
        return self.studio.session

    @property
    def landing(self) -> Landing | None:
        """What is below the object in the gripper, None where there is none."""
        session = self.studio.session
        return None if session is None or session.held is None else session.landing()

    @property
    def done(self) -> list[str]:
        """The actions of the demonstration in the making, in words."""
        session, name = self.studio.session, ""
        found = []
        for action in () if session is None else session.actions:
            name = action.nearest(Frames.of(session.task).objects) if action.kind == "pick" else name
            found.append(described(action, name, session.task))
        return found

    async def begin(self, *, reached: bool) -> None:
        """A new demonstration, from the start or from where the tree that was learnt ends."""
        studio, task = self.studio, self.studio.task
        if reached and studio.tree is None:
            raise UserError("no tree has been learnt yet; evolve one in step 2, or begin from the start")
        async with self._lock:
            if studio.session is not None and studio.session.actions:
                raise UserError("a demonstration is in the making; finish or discard it first")
            self.stop_replay()
            folder, tree = studio.shelf.folder, studio.tree if reached else None
            if (folder.path / "info.yaml").exists():
                folder.create(Frames.of(task))  # says now, and not at the end, that this set is for another task
            number = max(self._layout, len(studio.shelf.kept))
            layout = sample_layouts(task, [DEMONSTRATED, number], 1) if self.elsewhere else studio.start
            session = await studio.work(_begun, task, studio.physics, tree, layout)
            if (studio.task.boxes, studio.task.frames) != (task.boxes, task.frames):
                raise UserError("another task was chosen meanwhile; begin again")
            self._layout = number + 1
            studio.session = session
            self._shown()

    async def pick(self, name: str) -> None:
        """Takes an object and lifts it."""
        async with self._lock:
            await self.studio.work(self.session.pick, name)
            self._shown()

    async def move(self, direction: Direction) -> None:
        """Carries the held object one step, as seen by the person before the scene."""
        async with self._lock:
            self.session.move(self.step * _vector(self.studio.task, direction))
            self._shown()

    async def carry_over(self, frame: str) -> None:
        """Carries the held object straight over the middle of a frame, and up where it would touch what is there."""
        async with self._lock:
            session = self.session
            if session.held is None:
                raise UserError("the gripper holds nothing; pick an object first")
            height = float(session.position(frame)[2])
            low = OVER * next(box.size for box in session.task.boxes if box.name == session.held)
            session.move_to((0.0, 0.0, max(height, low)), frame)
            self._shown()

    async def release(self) -> None:
        """Sets the held object down on what is below, and lets it go."""
        async with self._lock:
            await self.studio.work(self.session.release, lowered=True)
            self._shown()

    async def undo(self) -> None:
        """Takes back the last action, or all steps since the pick."""
        async with self._lock:
            if not self.session.undo(moves_together=True):
                raise UserError("nothing was done yet, so nothing can be undone; pick an object")
            self._shown()

    async def finish(self) -> str:
        """Keeps the demonstration, learns anew, and returns its name."""
        async with self._lock:
            recorded = self.session.demonstration()
            frames, folder = Frames.of(self.session.task), self.studio.shelf.folder

            def keep() -> str:
                folder.create(frames)
                return folder.append(recorded).name

            name = await self.studio.work(keep)
            self.studio.session = None
        await self.studio.shelf.refresh()
        return name

    async def discard(self) -> None:
        """Forgets the demonstration in the making."""
        async with self._lock:
            if self.studio.session is not None:
                self.studio.session = None
                self.studio.show(self.studio.start)
                self.studio.changed("demonstrations")

    def set_step(self, step: float | None) -> None:
        """How far a key moves the gripper [m]."""
        if step is None or not STEPS[0] <= step <= 0.5:
            raise UserError("the step must be from 0.1 to 50 cm; choose another")
        self.step = float(step)
        self.studio.changed("demonstrations")

    def change_step(self, by: int) -> None:
        """The next larger (1) or smaller (-1) step."""
        others = [step for step in STEPS if (step - self.step) * by > 1e-9]
        if others:
            self.set_step(min(others, key=lambda step: abs(step - self.step)))

    async def replay(self, name: str) -> None:
        """Shows a demonstration again, scene by scene, until it ends or `stop_replay` is called."""
        async with self._lock:
            if self.studio.session is not None:
                raise UserError("a demonstration is in the making; finish or discard it first")
            found = await self.studio.work(_scenes, self.studio, name)
            self.stop_replay()
            self.replayed = name
            self._replay = asyncio.create_task(self._show_all(found))
        self.studio.changed("demonstrations")

    def stop_replay(self) -> None:
        """Ends a replay."""
        if self._replay is not None:
            self._replay.cancel()
        self._replay, self.replayed = None, None

    async def _show_all(self, found: list[Scene]) -> None:
        for scene in found:
            self.studio.show(scene.world)
            self.studio.say(f"{self.replayed}, {scene.sentence}")
            await asyncio.sleep(PACE)
        self._replay, self.replayed = None, None
        self.studio.changed("demonstrations")

    def _shown(self) -> None:
        self.studio.show(self.session.world)
        self.studio.changed("demonstrations")


def _begun(task: Task, physics: Physics, tree: Tree | None, layout: World) -> Teleoperation:
    """A demonstration that begins in a layout, or where a tree ends there."""
    return Teleoperation(task, physics, layout if tree is None else reached_by(tree, task, physics, layout))


def _vector(task: Task, direction: Direction) -> np.ndarray:
    """The unit vector of a direction in the world."""
    axes: Mapping[str, np.ndarray] = {
        "right": np.array(task.right),
        "left": -np.array(task.right),
        "away": np.array(task.away),
        "near": -np.array(task.away),
        "up": np.array([0.0, 0.0, 1.0]),
        "down": np.array([0.0, 0.0, -1.0]),
    }
    return axes[direction]


def _scenes(studio: Studio, name: str) -> list[Scene]:
    read = studio.shelf.folder.read()
    one = next((one for one in read if one.name == name), None)
    if one is None:
        raise UserError(
            f"the demonstration {name} cannot be replayed, since it cannot be read; delete it, or record it again"
        )
    return scenes(one, read.frames, studio.task, studio.physics)
