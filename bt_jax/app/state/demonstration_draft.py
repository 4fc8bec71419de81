"""The demonstration in the making on the disk: its start and what was done, so that it can be done again after a crash."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.app.state.workspace import Workspace
from bt_jax.mjx_env.driving import start as base_at_start
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task, task_from_dict
from bt_jax.tasks.bounds import POSITION
from bt_jax.teaching.teleoperation import Teleoperation

__all__ = ["DemonstrationDraft", "DraftKeeper", "InputKind", "drag"]

NOT_UNIT = 0.01  # by which the length of a rotation may differ from 1; the components of states are rounded to 0.001
LEAST_TURN = 0.001  # degrees; what is turned by less was not turned
InputKind = Literal["pick", "carry", "release", "drag"]


@dataclasses.dataclass(frozen=True)
class Input:
    """One input of a person: `what` is the object that is picked, or where it is carried [m] and how it is turned there
    [degrees], in the robot's frame; in an older draft there is no turn. To drag is all three at once, with both."""

    kind: InputKind
    what: Any = None


@dataclasses.dataclass(frozen=True, eq=False)
class DemonstrationDraft:
    """A demonstration of a task, for the set `set_name`, from the state `start` (a batch of one, NumPy). Motions between a
    pick and a release are one input, since they are undone at once."""

    task: Task
    set_name: str
    start: World
    inputs: tuple[Input, ...] = ()

    def then(self, kind: InputKind, what: Any = None) -> DemonstrationDraft:
        """Return the draft after another input."""
        kept = (
            self.inputs[:-1]
            if kind == "carry" and self.inputs[-1:] and self.inputs[-1].kind == "carry"
            else self.inputs
        )
        return dataclasses.replace(self, inputs=(*kept, Input(kind, what)))

    def undone(self) -> DemonstrationDraft:
        """Return the draft before its last input."""
        return dataclasses.replace(self, inputs=self.inputs[:-1])

    def session(self, physics: Physics) -> Teleoperation:
        """Do all of it again. Raise UserError if that is impossible, whatever the reason: a file may say anything."""
        session = Teleoperation(self.task, physics, self.start)
        try:
            for each in self.inputs:
                if each.kind == "pick":
                    session.pick(each.what)
                elif each.kind == "carry":
                    _carry(session, each.what)
                elif each.kind == "drag":
                    drag(session, each.what[0], each.what[1:])
                else:
                    session.release(lowered=True)
        except UserError:
            raise
        except Exception as error:
            raise UserError(f"it cannot be done again ({error}); demonstrate it again") from error
        return session

    def to_json(self) -> str:
        """Return the text of a file that `from_json` reads."""
        values = {field.name: getattr(self.start, field.name) for field in dataclasses.fields(World)}
        start = {name: value.tolist() for name, value in values.items() if value is not None}
        inputs = [[each.kind, each.what] for each in self.inputs]
        return json.dumps({"task": self.task.to_dict(), "set": self.set_name, "start": start, "inputs": inputs})

    @staticmethod
    def from_json(text: str) -> DemonstrationDraft:
        """Read what `to_json` has written. Raise UserError if it is damaged."""
        try:
            data = json.loads(text)
            task, start = task_from_dict(data["task"], source="its task", kept=True), data["start"]
            boxes = len(task.objects)
            kits = start["kits"] if "kits" in start else start["kit"]  # an older draft has the only one
            world = World(
                kits=np.array(kits, np.float32).reshape(1, len(task.kits), 3),
                poses=np.array(start["poses"], np.float32).reshape(1, boxes, 7),
                held=np.array(start["held"], np.int8).reshape(1),
                gripper_open=np.array(start["gripper_open"], bool).reshape(1),
                reached=np.array(start["reached"], bool).reshape(1, len(task.subgoals)),
                unseen=None if task.faults is None else np.zeros((1, boxes), bool),
                base=base_at_start(task, 1),
            )
            if world.base is not None:
                world = dataclasses.replace(world, base=np.array(start["base"], np.float32).reshape(1, 2))
            inputs = tuple(Input(kind, what) for kind, what in data["inputs"])
            valid = _is_plausible(world) and all(map(_is_valid, inputs))
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise UserError(f"it is damaged ({error}); demonstrate it again") from error
        if not (valid and isinstance(data["set"], str)):
            raise UserError("it is damaged; demonstrate it again")
        return DemonstrationDraft(task, data["set"], world, inputs)


def _is_plausible(world: World) -> bool:
    """Whether a demonstration may begin in a state: its numbers are in their bounds, and the gripper holds nothing."""
    lengths = np.linalg.norm(world.poses[..., 3:].astype(float), axis=-1)
    return bool(
        _within(world.kits, POSITION.low, POSITION.high)
        and _within(world.poses[..., :3], POSITION.low, POSITION.high)
        and _within(lengths, 1 - NOT_UNIT, 1 + NOT_UNIT)
        and np.all(world.held == -1)
    )


def _within(values: np.ndarray, low: float, high: float) -> bool:
    """Whether all are from `low` to `high`; a NaN is not."""
    return bool(np.all((values >= low) & (values <= high)))


def drag(session: Teleoperation, name: str, where: Sequence[float]) -> None:
    """Take an object, unless the gripper has it, carry it somewhere as `_carry` does, and let it go on what is below: one
    input. Raise UserError, and change nothing, if one of the three is impossible."""
    with session.together():
        if session.held != name:
            session.pick(name)
        _carry(session, where)
        session.release(lowered=True)


def _carry(session: Teleoperation, where: Sequence[float]) -> None:
    """Carry the held object to a position [m], and turn it as it was turned there [degrees], if that is known."""
    frame = session.task.robot_frame
    session.move_to(where[:3], frame)
    by = math.remainder(where[3] - session.turn(frame), 360.0) if len(where) > 3 else 0.0
    if abs(by) > LEAST_TURN:
        session.turn_by(by)


def _is_valid(each: Input) -> bool:
    if each.kind == "carry":
        return _is_place(each.what)
    if each.kind == "drag":
        return isinstance(each.what[0], str) and _is_place(each.what[1:])
    return each.kind == "release" or (each.kind == "pick" and isinstance(each.what, str))


def _is_place(what: Any) -> bool:
    far = POSITION.high - POSITION.low  # between the robot, whose frame it is in, and a place
    where = np.asarray(what, float)
    return where.shape in ((3,), (4,)) and _within(where[:3], -far, far) and _within(where[3:], -360.0, 360.0)


class DraftKeeper:
    """Keeps the newest draft on the disk, beside the event loop; `failed` is told why that is impossible."""

    def __init__(self, workspace: Workspace, failed: Callable[[UserError], None]) -> None:
        self._workspace, self._failed = workspace, failed
        self._wanted: DemonstrationDraft | None = None
        self._changed = False
        self._writing: asyncio.Task | None = None

    def keep(self, draft: DemonstrationDraft | None) -> None:
        """Keep a draft in place of the one before; with None, or nothing done in it, keep none."""
        self._wanted, self._changed = draft, True
        if self._writing is None or self._writing.done():
            self._writing = asyncio.get_running_loop().create_task(self._write())

    async def kept(self) -> None:
        """Wait until the newest draft is on the disk."""
        if self._writing is not None:
            await self._writing

    async def _write(self) -> None:
        while self._changed:
            self._changed, draft = False, self._wanted
            text = draft.to_json() if draft is not None and draft.inputs else None
            try:
                await asyncio.to_thread(self._workspace.keep_demonstration_draft, text)
            except UserError as error:
                self._failed(error)
