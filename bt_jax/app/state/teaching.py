"""Between the buttons and a demonstration: the gripper under a person's control, and what was demonstrated shown again.

One demonstration is in the making at a time, in `session`; all windows show it. Inputs are carried out one after the other,
in the order in which they come. An input that raises UserError has changed nothing.
"""

from __future__ import annotations

import asyncio
import dataclasses
import math
from typing import Any, Literal

from bt_jax._util.errors import UserError
from bt_jax.app.state.bus import Bus
from bt_jax.app.state.demonstration_draft import DemonstrationDraft, DraftKeeper, InputKind, drag
from bt_jax.app.state.demonstration_library import DemonstrationLibrary
from bt_jax.app.state.directions import Direction, next_turn, vector
from bt_jax.app.state.edited_task import EditedTask, same_things
from bt_jax.app.state.extents import Point, heading, poses_now
from bt_jax.app.state.playing import Playing
from bt_jax.app.state.replay import ReplayStep, described, replay_steps
from bt_jax.app.state.snapping import snapped
from bt_jax.app.state.worker import Worker
from bt_jax.behaviors import Tree
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.teaching.script import DEMONSTRATED, reached_by
from bt_jax.teaching.teleoperation import Landing, Teleoperation

__all__ = ["Teaching"]

STEP_SIZES = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2)  # metres, for the keys + and -
FIRST_STEP = 0.02
OVER = 0.5  # how far the held object is carried over another, in its heights
PACE = 0.9  # seconds for which each step of a replay is shown


class Teaching:
    """`session` is the demonstration in the making, `shown` the state that the scene shows in the steps around teaching, a
    batch of one (NumPy). `step` is how far a key moves the gripper [m]; with `elsewhere`, each demonstration begins in
    another layout. `replayed` is the name of the demonstration that is being replayed."""

    def __init__(
        self,
        bus: Bus,
        worker: Worker,
        edited: EditedTask,
        library: DemonstrationLibrary,
        playing: Playing,
        drafts: DraftKeeper,
    ) -> None:
        self.session: Teleoperation | None = None
        self.shown: World = edited.start
        self.step = FIRST_STEP
        self.elsewhere = True
        self.replayed: str | None = None
        self._bus, self._worker, self._edited = bus, worker, edited
        self._library, self._playing, self._drafts = library, playing, drafts
        self._folder = library.folder  # the set that the demonstration in the making belongs to
        self._draft: DemonstrationDraft | None = None
        self._replay: asyncio.Task | None = None
        self._lock = asyncio.Lock()
        self._layout = 0  # number of the next random layout

    @property
    def busy(self) -> bool:
        """Whether a demonstration is in the making that would be lost."""
        return self.session is not None and bool(self.session.actions)

    @property
    def at_work(self) -> bool:
        """Whether an input is being carried out."""
        return self._lock.locked()

    @property
    def draft(self) -> DemonstrationDraft | None:
        """What is kept on the disk of the demonstration in the making, another one after each input."""
        return None if self.session is None else self._draft

    @property
    def landing(self) -> Landing | None:
        """What is below the object in the gripper, None if the gripper is empty."""
        session = self.session
        return None if session is None or session.held is None else session.landing()

    @property
    def done(self) -> list[str]:
        """The actions of the demonstration in the making, in words."""
        session, name = self.session, ""
        found: list[str] = []
        if session is None:
            return found
        for action in session.actions:
            name = action.nearest(Frames.of(session.task).objects) if action.kind == "pick" else name
            found.append(described(action, name, session.task))
        return found

    def task_opened(self) -> None:
        """Begin with another task: whatever was in the making is dropped."""
        self.stop_replay()
        self.session, self.shown = None, self._edited.start

    def task_edited(self) -> None:
        """Go on with the task after an edit; a demonstration in the making stays where it is."""
        self.stop_replay()
        world = self._edited.start if self.session is None else self.shown
        self.shown = dataclasses.replace(world, reached=subgoals_by_sight(self._edited.task, world))

    async def begin(self, *, reached: bool, start: World | None = None) -> None:
        """Begin a demonstration, from the start, or that which is given (a batch of one), or from where the tree ends."""
        task = self._edited.task
        if reached and self._playing.tree is None:
            raise UserError("no tree has been learnt yet; evolve one in step 2, or begin from the start")
        async with self._lock:
            if self.busy:
                raise UserError("a demonstration is in the making; finish or discard it first")
            self.stop_replay()
            folder, tree = self._library.folder, self._playing.tree if reached else None
            if (folder.path / "info.yaml").exists():
                folder.create(Frames.of(task))  # says now, and not at the end, that this set is for another task
            number = max(self._layout, folder.next_layout())
            layout = start or (
                sample_layouts(task, [DEMONSTRATED, number], 1) if self.elsewhere else self._edited.start
            )
            session = await self._worker.work(_begun, task, self._worker.physics(task), tree, layout)
            if not same_things(self._edited.task, task):
                raise UserError("another task was chosen meanwhile; begin again")
            self._layout = number + 1
            self.session = session
            self._folder, self._draft = folder, DemonstrationDraft(task, self._library.set_name, session.world)
            self._show_session()

    def restore(self, draft: DemonstrationDraft, session: Teleoperation) -> None:
        """Go on with a demonstration that an earlier page has left, and that was done again in `session`. Raise UserError
        if its set cannot be used; its task must have the objects and frames of the one that is edited."""
        self._folder = self._library.restore_set(draft.set_name)
        self.session, self._draft = session, draft
        self.shown = session.world

    async def pick(self, name: str) -> None:
        """Take an object and lift it."""
        async with self._lock:
            session = self._making()
            await self._worker.work(session.pick, name)
            self._done("pick", name)

    async def move(self, direction: Direction) -> None:
        """Carry the held object one step, as seen by the person before the scene."""
        async with self._lock:
            session = self._making()
            session.move(self.step * vector(self._edited.task, direction))
            self._carried(session)

    async def carry_over(self, frame: str) -> None:
        """Carry the held object straight over the middle of a frame, and up if it would touch what is there."""
        async with self._lock:
            session = self._making()
            if session.held is None:
                raise UserError("the gripper holds nothing; pick an object first")
            height = float(session.position(frame)[2])
            held, below = session.task.thing(session.held), session.task.instances.get(frame, (session.held,))[0]
            low = (held.height + session.task.thing(below).height) / 2 + OVER * held.height
            session.move_to((0.0, 0.0, max(height, low)), frame)
            self._carried(session)

    async def carry_to_slot(self, name: str) -> None:
        """Carry the held object straight over a slot, such as "TrayA.a1", turned as it lies there."""
        async with self._lock:
            session = self._making()
            up = 0.0 if session.held is None else OVER * session.task.thing(session.held).height
            session.move_to_slot(name, off=(0.0, 0.0, up))
            self._carried(session)

    async def turn(self, way: Literal[-1, 1]) -> None:
        """Turn the held object to the next round angle, with 1 counter-clockwise as seen from above."""
        async with self._lock:
            session = self._making()
            now = session.turn(session.task.robot_frame)
            session.turn_by(next_turn(now, way) - now)
            self._carried(session)

    async def drag(self, name: str, position: Point, turn: float) -> str:
        """Take an object, unless it is in the gripper, carry its centre to a position [m, world], turned by degrees from how
        it lies, and let it go on what is below: one input. Close to a slot, it goes into that. Return which, such as "slot
        a1 of TrayA", empty if there is none."""
        async with self._lock:
            session = self._making()
            slot = snapped(session.task, session.world, name, position)
            place = position if slot is None else slot.position
            lies = heading(poses_now(session.task, session.world)[name]) + turn
            if slot is not None and slot.turn is not None:
                lies += math.remainder(slot.turn - lies, session.task.thing(name).symmetry or 360.0)
            where = [*(place - session.task.robot_position).tolist(), math.remainder(lies, 360.0)]
            await self._worker.work(drag, session, name, where)
            self._done("drag", [name, *where])
        return "" if slot is None else slot.slot

    async def release(self) -> None:
        """Set the held object down on what is below, and let it go; nothing happens if the gripper is empty."""
        async with self._lock:
            session = self._making()
            if session.held is None:
                return
            await self._worker.work(session.release, lowered=True)
            self._done("release")

    async def undo(self) -> None:
        """Take back the last action, or all steps since the pick."""
        async with self._lock:
            session = self._making()
            if not session.undo(moves_together=True):
                raise UserError("nothing was done yet, so nothing can be undone; pick an object")
            self._draft = None if self._draft is None else self._draft.undone()
            self._show_session()

    async def finish(self) -> str:
        """Keep the demonstration, learn again, and return its name."""
        async with self._lock:
            session = self._making()
            recorded, frames, folder = session.demonstration(), Frames.of(session.task), self._folder
            used = self._layout

            def keep() -> str:
                folder.create(frames)
                folder.use_layouts(used)
                return folder.append(recorded).name

            name = await self._worker.work(keep)
            self.session = None
            self._keep_draft()
        await self._library.refresh()
        return name

    async def discard(self) -> None:
        """Drop the demonstration in the making."""
        async with self._lock:
            if self.session is not None:
                self.session = None
                self._keep_draft()
                self.show(self._edited.start)
                self._bus.changed("demonstrations")

    def show(self, world: World) -> None:
        """Show a state, a batch of one (NumPy), in the scene."""
        self.shown = world
        self._bus.changed("scene")

    def set_step(self, step: float | None) -> None:
        """Set how far a key moves the gripper [m]."""
        if step is None or not STEP_SIZES[0] <= step <= 0.5:
            raise UserError("the step must be from 1 to 500 mm; choose another")
        self.step = float(step)
        self._bus.changed("demonstrations")

    def set_elsewhere(self, elsewhere: bool) -> None:
        """Set whether each demonstration begins in another layout."""
        self.elsewhere = elsewhere
        self._bus.changed("demonstrations")

    def change_step(self, by: int) -> None:
        """Take the next larger (1) or smaller (-1) step."""
        others = [step for step in STEP_SIZES if (step - self.step) * by > 1e-9]
        if others:
            self.set_step(min(others, key=lambda step: abs(step - self.step)))

    async def replay(self, name: str) -> None:
        """Show a demonstration again, step by step, until it ends or `stop_replay` is called."""
        async with self._lock:
            if self.session is not None:
                raise UserError("a demonstration is in the making; finish or discard it first")
            folder, task = self._library.folder, self._edited.task
            steps = await self._worker.work(_replay, folder, name, task, self._worker.physics(task))
            self.stop_replay()
            self.replayed = name
            self._replay = asyncio.create_task(self._show_all(steps))
        self._bus.changed("demonstrations")

    def stop_replay(self) -> None:
        """End a replay."""
        if self._replay is not None:
            self._replay.cancel()
        self._replay, self.replayed = None, None

    async def _show_all(self, steps: list[ReplayStep]) -> None:
        for step in steps:
            self.show(step.world)
            self._bus.say(f"{self.replayed}, {step.sentence}")
            await asyncio.sleep(PACE)
        self._replay, self.replayed = None, None
        self._bus.changed("demonstrations")

    def _making(self) -> Teleoperation:
        """Return the demonstration in the making. Raise UserError if there is none."""
        if self.session is None:
            raise UserError("no demonstration is in the making; begin a new one first")
        return self.session

    def _carried(self, session: Teleoperation) -> None:
        frame = session.task.robot_frame
        self._done("carry", [*session.position(frame).tolist(), session.turn(frame)])

    def _done(self, kind: InputKind, what: Any = None) -> None:
        self._draft = None if self._draft is None else self._draft.then(kind, what)
        self._show_session()

    def _show_session(self) -> None:
        self._keep_draft()
        self.show(self._making().world)
        self._bus.changed("demonstrations")

    def _keep_draft(self) -> None:
        self._drafts.keep(self.draft)


def _begun(task: Task, physics: Physics, tree: Tree | None, layout: World) -> Teleoperation:
    """Return a demonstration that begins in a layout, or where a tree ends there."""
    return Teleoperation(task, physics, layout if tree is None else reached_by(tree, task, physics, layout))


def _replay(folder: DemonstrationFolder, name: str, task: Task, physics: Physics) -> list[ReplayStep]:
    read = folder.read()
    one = next((one for one in read if one.name == name), None)
    if one is None:
        raise UserError(
            f"the demonstration {name} cannot be replayed, since it cannot be read; delete it, or record it again"
        )
    return replay_steps(one, read.frames, task, physics)
