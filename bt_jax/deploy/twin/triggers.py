"""When something goes wrong in the twin's cell: at a time that the seed chooses, or where a hand is in the right place."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.twin.person import free_boxes
from bt_jax.tasks import Task

__all__ = ["Moment", "Trigger"]

SOON = (3.0, 15.0)  # s after the start, within which most disturbances happen
ABOVE = (0.02, 0.055)  # m of the TCP over a box's centre, where a hand is about to close around it
STRAIGHT = 0.008  # m by which it is beside that centre


@dataclasses.dataclass(frozen=True)
class Moment:
    """One tick: time since the start [s], what the executor did, the true poses of the boxes and points between the fingers,
    both in the world."""

    time: float
    shown: TickReport
    boxes: Mapping[str, RigidTransform]
    hands: Mapping[str, Point]

    def doing(self, name: str) -> str | None:
        """Return the object that an action of that name is carried out with, None if another is, or any of a part."""
        action = self.shown.action
        return action.object if action is not None and action.name == name and action.object in self.boxes else None

    def free(self, task: Task) -> list[str]:
        """Return the boxes that no hand is near and no other stands on."""
        free = free_boxes(task, self.boxes, self.hands.values())
        return [name for name in free if name != self.shown.seen.holding]


class Trigger:
    """Chooses from `rng` the `time` at which something happens at the earliest, in seconds after the start, and whether it
    happens to the first box that is acted on or to the second."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.time = float(rng.uniform(*SOON))
        self._skipped = int(rng.integers(2))  # picks or places that it lets pass
        self._boxes: list[str] = []  # of those, in their order
        self._since: float | None = None  # when what it waits for began

    def due(self, moment: Moment) -> bool:
        """Has that time come?"""
        return moment.time >= self.time

    def descended_on(self, moment: Moment) -> str | None:
        """Return the chosen box if a hand is straight above it and about to close around it."""
        box = self.chosen(moment.doing("pick"))
        if box is None:
            return None
        away = [hand - moment.boxes[box].translation for hand in moment.hands.values()]
        low, high = ABOVE
        there = any(np.linalg.norm(by[:2]) < STRAIGHT and low < by[2] < high for by in away)
        return box if there else None

    def chosen(self, box: str | None) -> str | None:
        """Return the box of an action, if enough boxes were acted on before it."""
        if box is not None and box not in self._boxes:
            self._boxes.append(box)
            self._since = None
        return box if box is not None and len(self._boxes) > self._skipped else None

    def lasted(self, moment: Moment, seconds: float) -> bool:
        """Have the conditions under which this is called lasted for so long?"""
        self._since = moment.time if self._since is None else self._since
        return moment.time - self._since >= seconds
