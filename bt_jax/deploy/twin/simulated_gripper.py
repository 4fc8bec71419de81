"""The twin's gripper, and what the RAPID program does with it: a look every now and then, and commands that take a while."""

from __future__ import annotations

import collections
import dataclasses
import enum

from bt_jax.deploy.twin.settings import Realism

__all__ = ["Grip", "GripperFault", "SimulatedGripper"]

STEP = 0.05  # mm: smaller changes of the target are none, as in BtJax
WEAK = 0.03  # N with which fingers press that hold nothing: friction carries 7 g then


class GripperFault(enum.StrEnum):
    """What is wrong with a gripper: nothing, it does not move as it is told, or it hardly presses."""

    NONE, JAM, WEAK = "none", "jam", "weak"


@dataclasses.dataclass(frozen=True)
class Grip:
    """What the fingers do: move to `target` [mm each] with at most `force` [N]."""

    target: float
    force: float


class SimulatedGripper:
    """The gripper of one arm. As in BtJax, opening goes to the target; closing goes on until something or the end is met."""

    def __init__(self, realism: Realism, position: float, force: float) -> None:
        self._delay, self._period = realism.gripper_delay, realism.gripper_reading
        self._told, self._looked = position, float("-inf")
        self._underway: collections.deque[tuple[float, Grip]] = collections.deque()
        self.reading = position  # mm of each finger, as the program read it last
        self.grip = Grip(position, force)
        self.fault = GripperFault.NONE

    def serve(self, now: float, *, target: float, force: float, position: float) -> None:
        """Do what the program does in a turn of its loop, at the time `now` [s]: read the fingers, pass a new target on."""
        if now - self._looked < self._period - 1e-6:
            return
        self._looked, self.reading = now, position
        if abs(target - self._told) > STEP:
            if self.fault != GripperFault.JAM:
                self._underway.append((now + self._delay, Grip(0.0 if target < self._told else target, force)))
            self._told = target

    def advance(self, now: float) -> Grip:
        """Return what the fingers do now."""
        while self._underway and self._underway[0][0] <= now + 1e-6:
            self.grip = self._underway.popleft()[1]
        if self.fault == GripperFault.WEAK:
            return dataclasses.replace(self.grip, force=min(WEAK, self.grip.force))
        return self.grip
