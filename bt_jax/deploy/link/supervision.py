"""Watches the robot while it runs: what goes wrong (silence, lost messages, another state, a setpoint out of bounds, an arm
that does not follow, arms too near to each other) latches a stop, until a person starts the program again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bt_jax.deploy.link.egm import Feedback
from bt_jax.deploy.link.safety import Rejected, Rules, check_setpoint, least_clearance
from bt_jax.deploy.robot.arrays import Joints

__all__ = ["Supervisor"]


class Supervisor:
    """Watches one cycle after the other; knows no clock and no socket, so that every fault can be tried on it.

    `reason` is None until something goes wrong, then says what, for good. The arms come to rest on their paths then, which
    were checked; `braking` says that a path itself is in doubt, and that they must leave it and brake at once.
    """

    def __init__(self, rules: Rules, arms: tuple[str, ...]) -> None:
        self.rules, self.arms = rules, arms
        self.reason: str | None = None
        self.braking = False
        self.lost = self.reordered = 0
        self._sequence: dict[str, int] = {}
        self._heard: dict[str, float] = {}
        self._clock: dict[str, tuple[float, float]] = {}  # time of the controller, and when it was heard first [s]
        self._clearance = rules.clearance_of() if rules.clearance_of is not None else None
        self._least: float | None = None  # m of clearance that are kept; `rules.clearance` until the first path begins

    def stop(self, reason: str, *, brake: bool = False) -> None:
        """Latch a stop; the first reason stays."""
        self.reason = self.reason or reason
        self.braking = self.braking or brake

    def accept(self, arm: str, feedback: Feedback, now: float, *, moving_allowed: bool) -> bool:
        """Take a message at the time `now` [s]; return False if it is older than one before and must be ignored."""
        last = self._sequence.get(arm)
        if last is not None:
            ahead = (feedback.sequence - last + (1 << 31)) % (1 << 32) - (1 << 31)
            if ahead <= 0 and (moving_allowed or ahead > -self.rules.gap):
                self.reordered += 1
                return False
            ahead = max(ahead, 1)  # a new session: its numbers begin again
            self.lost += ahead - 1
            if ahead - 1 > self.rules.gap and moving_allowed:
                self.stop(f"{arm}: {ahead - 1} messages of the controller were lost in a row")
        self._sequence[arm], self._heard[arm] = feedback.sequence, now
        if self._clock.get(arm, (None, now))[0] != feedback.time:
            self._clock[arm] = feedback.time, now
        elif moving_allowed and not now - self._clock[arm][1] <= self.rules.stale:  # no setpoint moves on
            self.stop(f"{arm}: the controller's clock stands still")
        if not np.isfinite(feedback.joints).all():
            self.stop(f"{arm}: the measured joints are not numbers")
        if moving_allowed and not feedback.running:
            self.stop(
                f"{arm}: the controller is not running (motors {'on' if feedback.motors_on else 'off'}, "
                f"EGM {feedback.mci.name.lower()}, RAPID {'running' if feedback.rapid_running else 'stopped'})"
            )
        return True

    def silence(self, arm: str, now: float) -> float:
        """Return the seconds since the last message of an arm; 0 if there was none."""
        return now - self._heard.get(arm, now)

    def watch(self, now: float, alive: float, *, moving: bool) -> None:
        """Latch a stop if an arm is silent, or the executor gave its last sign of life, `alive`, too long ago [s]."""
        for arm in self.arms:
            silence = self.silence(arm, now)
            if not silence <= self.rules.stale:
                self.stop(f"{arm}: no feedback for {silence:.2f} s; the controller or the network is down")
        if not now - alive <= (self.rules.overrun if moving else self.rules.idle):
            self.stop(f"the executor gave no sign of life for {now - alive:.1f} s; a tick takes too long")

    def permits(self, arm: str, target: Joints, *, before: Joints) -> bool:
        """May an arm be sent there from its setpoint before? Latch a stop if not."""
        try:
            check_setpoint(self.rules, arm, target, before=before)
        except Rejected as broken:
            self.stop(str(broken), brake=True)
            return False
        return True

    def keep_up(self, arm: str, off: float) -> None:
        """Latch a stop if an arm is measured too far off all that it was sent recently [rad]."""
        if not off <= self.rules.lag:  # also where a joint is not a number
            self.stop(f"{arm}: the arm is {np.degrees(off):.0f} deg from its setpoint; something holds it", brake=True)

    def begin_path(self, joints: Mapping[str, Joints]) -> None:
        """Take note, as a path begins, of where the arms are: too near, they may move as long as they come no nearer."""
        if self._clearance is None or len(joints) < len(self.arms):
            return
        if self._least is None:
            self._least = least_clearance(self.rules, self._clearance(joints))
        elif self._least < self.rules.clearance:  # what was gained is kept
            self._least = max(self._least, least_clearance(self.rules, self._clearance(joints)))

    def keep_clear(self, joints: Mapping[str, Joints], what: str) -> None:
        """Latch a stop if the arms, at these joints, are too near to each other or to anything fixed."""
        if self._clearance is None or len(joints) < len(self.arms):
            return
        distance = self._clearance(joints)
        if not distance >= (self.rules.clearance if self._least is None else self._least):
            self.stop(
                f"the arms came as near as {1000 * distance:.0f} mm to each other or to a fixture, by their {what}",
                brake=True,
            )
