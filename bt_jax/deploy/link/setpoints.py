"""The setpoints of one arm, each within reach of the one before: bounded in position, speed and acceleration, whatever is
asked for.

A stop is no jump to where the arm is measured. A ramp of our own and not Ruckig's, which plans for equal cycles and without
bounds of position: here a cycle lasts as long as the controller says, and an arm may begin outside its bounds.
"""

from __future__ import annotations

import collections

import numpy as np

from bt_jax.deploy.link.safety import Rules, bounds
from bt_jax.deploy.robot.arrays import Joints

__all__ = ["ElapsedTime", "SetpointStream"]


SLICES = 4  # of the rules' `response`, for each of which the least and the largest setpoints are kept
ROUNDED = 0.0011  # seconds by which a difference of whole milliseconds may be off


class ElapsedTime:
    """For how long a message may move an arm on: the time since the one before by the controller's clock, but no longer than
    by ours, and than `longest` [s]. Neither a clock that jumps nor a burst of messages moves an arm faster."""

    def __init__(self, longest: float) -> None:
        self._longest = self._left = longest
        self._time: float | None = None
        self._stamp: float | None = None
        self._now = 0.0

    def since_last(self, time: float, now: float, stamp: float | None = None) -> float:
        """Return the seconds, 0 to `longest`, for a message of `time` by the controller's clock, answered at `now`, ours.
        `stamp`: the same in finer steps, where it is known; `time` is in milliseconds."""
        passed = 0.0 if self._time is None else time - self._time
        ours = 0.0 if self._time is None else now - self._now
        if self._stamp is not None and stamp is not None and abs(stamp - self._stamp - passed) <= ROUNDED:
            passed = stamp - self._stamp
        self._time, self._stamp, self._now = time, stamp, now
        if ours > 0:
            self._left = min(self._left + ours, self._longest)
        seconds = min(passed, self._left) if passed > 0 else 0.0
        self._left -= seconds
        return seconds


class SetpointStream:
    """What an arm is sent, from its first setpoint on; `joints` is the last one and `velocity` its mean over the last cycle
    [rad/s]. The arm can always be brought to rest before a bound: each velocity leaves room for that."""

    def __init__(self, rules: Rules, joints: Joints) -> None:
        self.joints, self.velocity = np.array(joints, float), np.zeros(len(joints))
        self._rules = rules
        self._speed = np.minimum(rules.speed, rules.override)
        self._acceleration = np.broadcast_to(np.array(rules.acceleration, float), self.joints.shape)
        self._lower, self._upper = bounds(rules)
        self._target = self.joints  # where the path was, at the last setpoint
        self._recent = collections.deque([(self.joints, self.joints)], SLICES + 1)  # least and largest setpoints
        self._age = 0.0  # seconds of the newest slice

    @property
    def resting(self) -> bool:
        return not self.velocity.any()

    def track(self, target: Joints, seconds: float) -> Joints:
        """Return the next setpoint of a path that is at `target` after this cycle: that, or what can be reached of it."""
        if seconds > 0:
            behind = self._target - self.joints
            half = self._acceleration * (seconds / 2)
            catch_up = (
                np.sqrt(half * half + self._acceleration * np.abs(behind)) - half
            )  # and no faster: it must end there
            self._advance((target - self._target) / seconds + np.copysign(catch_up, behind), seconds)
            self._target = target
        return self.joints

    def brake(self, seconds: float) -> Joints:
        """Return the next setpoint on the way to rest: straight on in joint space, as fast as the accelerations permit."""
        if self.resting:
            self._remember(seconds)
        elif seconds > 0:
            self._advance(self.velocity * max(0.0, 1 - seconds / self._braking()), seconds)
        self._target = self.joints
        return self.joints

    def rest(self) -> Joints:
        """Return where the arm would be at rest if it braked from now on."""
        return self.joints + self.velocity * (self._braking() / 2)

    def off(self, measured: Joints) -> float:
        """Return by how much a measurement is outside everything that was sent within the rules' `response` [rad]."""
        lows, highs = zip(*self._recent, strict=True)
        return float(np.maximum(np.min(lows, axis=0) - measured, measured - np.max(highs, axis=0)).max())

    def _braking(self) -> float:
        """Return the seconds that braking takes."""
        return float((np.abs(self.velocity) / self._acceleration).max())

    def _advance(self, velocity: Joints, seconds: float) -> None:
        change = self._acceleration * seconds
        velocity = np.minimum(np.maximum(velocity, self.velocity - change), self.velocity + change)
        velocity = np.minimum(np.maximum(velocity, -self._speed), self._speed)
        above, below = np.maximum(self._upper - self.joints, 0.0), np.maximum(self.joints - self._lower, 0.0)
        most, least = self._stoppable(above, change), -self._stoppable(below, change)
        self.velocity = np.minimum(np.maximum(velocity, least), most)
        self.joints = self.joints + self.velocity * seconds
        self._remember(seconds)

    def _stoppable(self, room: Joints, change: Joints) -> Joints:
        """Return the speeds v of this cycle, of T seconds, from which braking ends within the room [rad]: the solution of
        v T + v^2 / (2 a) = room, where `change` is a T."""
        return np.sqrt(change * change + 2 * self._acceleration * room) - change

    def _remember(self, seconds: float) -> None:
        self._age += seconds
        if self._age >= self._rules.response / SLICES:
            self._recent.append((self.joints, self.joints))
            self._age = 0.0
        low, high = self._recent[-1]
        self._recent[-1] = np.minimum(low, self.joints), np.maximum(high, self.joints)
