"""The memory that the link process and the program share: states of the arms, counters, cycles for the log, stops."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.link.egm import Feedback
from bt_jax.deploy.link.loop_timing import LoopTimer
from bt_jax.deploy.link.protocol import ArmState, Records
from bt_jax.deploy.link.realtime import CONTEXT, Snapshot
from bt_jax.deploy.link.reception import Reception
from bt_jax.deploy.robot.arrays import Joints, PoseRow

__all__ = ["COUNTERS", "MotionState", "SharedState"]

HISTORY = 8192  # cycles of one arm that are kept for the log
COUNTERS = ("cycles", "missed", "late", "lost", "reordered", "clipped")


@dataclasses.dataclass(frozen=True)
class MotionState:
    """What an arm does of the paths that it was given."""

    moving: bool  # follows a path
    motion: int  # number of the path that was accepted last
    remaining: float  # seconds to the end of the path


class SharedState:
    """Written by the link process, read by the program; `alive` and `interrupted` the other way round. Each arm has the same
    number of `joints`."""

    def __init__(self, arms: tuple[str, ...], joints: int) -> None:
        self._joints = joints
        self._record = 3 + 2 * joints  # numbers of a record: arm, time, setpoint, measured, sequence
        fields = 1 + 3 * joints + 7 + 5  # time; joints, velocity, commanded; flange; five of the motion
        self.arms = {arm: Snapshot(fields) for arm in arms}
        self.receptions = {arm: Snapshot(len(dataclasses.fields(Reception))) for arm in arms}
        self.counters = Snapshot(len(COUNTERS))
        self.alive = CONTEXT.RawValue("d", 0.0)  # the executor's last sign of life, `time.monotonic()`
        self.interrupted = CONTEXT.RawValue("b", 0)  # everything must come to rest
        self._reason = CONTEXT.RawArray("c", 512)
        self._stopped = CONTEXT.RawValue("b", 0)  # `_reason` is complete
        self._history = CONTEXT.RawArray("d", HISTORY * self._record)
        self._written = CONTEXT.RawValue("L", 0)  # records so far
        self.loop_timer = LoopTimer(("messages", "commands", "supervision"))

    def write_arm(self, arm: str, feedback: Feedback, velocity: Joints, commanded: Joints, motion: MotionState) -> None:
        """Replace the state of an arm."""
        flange = [np.nan] * 7 if feedback.flange is None else feedback.flange
        numbers = [motion.moving, motion.motion, motion.remaining, feedback.running, 1.0]
        state = [feedback.time, *feedback.joints, *velocity, *commanded, *flange, *numbers]
        self.arms[arm].write(np.array(state, float))

    def read_arm(self, arm: str, *, opening: float, grip_target: float) -> ArmState | None:
        """Return the state of an arm, None before its first feedback; its gripper's numbers come from elsewhere."""
        values = self.arms[arm].read()
        n = self._joints
        moving, motion, remaining, running, known = values[3 * n + 8 :]
        if not known:
            return None
        return ArmState(
            time=float(values[0]),
            joints=values[1 : n + 1],
            velocity=values[n + 1 : 2 * n + 1],
            commanded=values[2 * n + 1 : 3 * n + 1],
            moving=bool(moving),
            motion=int(motion),
            remaining=float(remaining),
            running=bool(running),
            flange=_pose(values[3 * n + 1 : 3 * n + 8]),
            opening=opening,
            grip_target=grip_target,
        )

    def record(self, arm: str, feedback: Feedback, commanded: Joints) -> None:
        """Keep one cycle of an arm for the log."""
        index, written = list(self.arms).index(arm), self._written.value
        row = [index, feedback.time, *commanded, *feedback.joints, feedback.sequence]
        np.frombuffer(self._history).reshape(HISTORY, self._record)[written % HISTORY] = row
        self._written.value = written + 1

    def records(self, since: int) -> tuple[Records, int]:
        """Return the cycles after the first `since`, without those that were overwritten, and how many there are in all."""
        written = self._written.value
        rows = np.frombuffer(self._history).reshape(HISTORY, self._record)
        first = max(since, written - HISTORY + 64)
        return rows[np.arange(first, written) % HISTORY].copy(), written

    def tell_stop(self, reason: str) -> None:
        """Publish why a protective stop was latched."""
        self._reason.value = reason.encode()[:511]
        self._stopped.value = True

    def stop_reason(self) -> str | None:
        """Return why a protective stop was latched, None if none was."""
        return self._reason.value.decode(errors="replace") if self._stopped.value else None


def _pose(values: PoseRow) -> RigidTransform | None:
    """Return the transform; None if the numbers are not finite."""
    if not np.all(np.isfinite(values)):
        return None
    return RigidTransform.from_components(values[:3], Rotation.from_quat(values[3:], scalar_first=True))
