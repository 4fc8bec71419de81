"""Joint trajectories, and following one cycle by cycle; stopping in mid-way slows down along the path itself."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.deploy.robot.arrays import JointRows, Joints

__all__ = ["HALT", "Follower", "Trajectory"]

HALT = 0.3  # seconds in which a halted motion comes to rest


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """Where the joints of one arm are at which time; straight in joint space in between."""

    times: Float[np.ndarray, " n"]  # ascending from 0, s
    joints: JointRows  # chain order, rad

    def __post_init__(self) -> None:
        times, joints = np.asarray(self.times, float), np.asarray(self.joints, float)
        if joints.ndim != 2 or times.shape != joints.shape[:1] or len(times) < 1:
            raise UserError(
                f"a trajectory has times [n] and joints [n, joints of the arm], found {times.shape}, {joints.shape}; "
                "give one time for each row of joints"
            )
        if times[0] != 0 or not np.all(np.diff(times) > 0):
            raise UserError("the times of a trajectory must ascend from 0; begin at 0 and let each be later")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "joints", joints)

    @property
    def duration(self) -> float:
        return float(self.times[-1])

    def at(self, time: float) -> Joints:
        """Return the joints at a time [s]; before the start and after the end, those of the ends."""
        i = int(np.searchsorted(self.times, time, side="right"))
        if i == 0 or i == len(self.times):
            return self.joints[min(i, len(self.times) - 1)].copy()
        part = (time - self.times[i - 1]) / (self.times[i] - self.times[i - 1])
        return (1 - part) * self.joints[i - 1] + part * self.joints[i]

    def speeds(self) -> JointRows:
        """Return the joint speeds between the points, rad/s; one row fewer than there are points."""
        return np.diff(self.joints, axis=0) / np.diff(self.times)[:, None]

    def slowed(self, factor: float) -> Trajectory:
        """Return the same path in `factor` times the time."""
        return Trajectory(self.times * factor, self.joints)


class Follower:
    """Where on its path an arm is. It comes to rest on the path, and gets up to speed again, within `ramp` seconds; while
    `paused` is set it does not go on. Each call of `advance` is one cycle."""

    def __init__(self, trajectory: Trajectory, *, ramp: float = HALT) -> None:
        self.trajectory = trajectory
        self.paused = False
        self._ramp = ramp
        self._time, self._rate, self._halting = 0.0, 1.0, False

    @property
    def done(self) -> bool:
        """At the end of the path, or at rest on it for good."""
        return (self._halting and self._rate <= 0) or self._time >= self.trajectory.duration

    @property
    def remaining(self) -> float:
        """Seconds to the end of the path, 0 once done."""
        return 0.0 if self.done else self.trajectory.duration - self._time

    def halt(self) -> None:
        """Come to rest on the path, for good."""
        self._halting = True

    def advance(self, seconds: float) -> Joints:
        """Return the joints for the next cycle, `seconds` later."""
        change = seconds / self._ramp
        self._rate = max(0.0, self._rate - change) if self._halting or self.paused else min(1.0, self._rate + change)
        self._time = min(self._time + self._rate * seconds, self.trajectory.duration)
        return self.trajectory.at(self._time)
