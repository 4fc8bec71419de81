"""How the twin's arms follow setpoints: after a delay, through a filter, and no faster than the program lets them."""

from __future__ import annotations

import collections
import math

import numpy as np

from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.twin.settings import Realism

__all__ = ["SetpointFilter"]


class SetpointFilter:
    """From setpoints to the reference of an arm's servos: a dead time, then two equal low passes in a row (critically
    damped), which trail behind a steady motion by `realism.egm_lag`. Joints are in chain order [rad], times in s."""

    def __init__(self, realism: Realism, joints: Joints) -> None:
        self._delay, self._step = realism.egm_delay, realism.egm_speed * CYCLE
        self._share = 1 - math.exp(-2 * CYCLE / realism.egm_lag) if realism.egm_lag > 0 else 1.0
        self._underway: collections.deque[tuple[float, Joints]] = collections.deque()
        self._goal = self._smooth = self.reference = joints.copy()

    def take(self, joints: Joints, now: float) -> None:
        """Take a setpoint."""
        self._underway.append((now + self._delay, joints))

    def advance(self, now: float) -> Joints:
        """Return the reference of the next cycle."""
        while self._underway and self._underway[0][0] <= now + CYCLE / 2:
            self._goal = self._underway.popleft()[1]
        self._smooth = self._smooth + self._share * (self._goal - self._smooth)
        change = self._share * (self._smooth - self.reference)
        self.reference = self.reference + np.clip(change, -self._step, self._step)
        return self.reference

    def brake(self) -> None:
        """Come to rest from here: what is under way counts no more."""
        self._underway.clear()
        self._goal = self._smooth.copy()

    def begin(self, joints: Joints) -> None:
        """Rest at these joints, at once."""
        self._underway.clear()
        self._goal = self._smooth = self.reference = joints.copy()
