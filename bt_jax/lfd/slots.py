"""Slots of kits in demonstrated places."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from bt_jax.lfd.clustering import Observed, Vec3
from bt_jax.lfd.contact import supports
from bt_jax.lfd.turns import REACH, Turn, apart, shown_turn
from bt_jax.tasks import Object, Task
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from bt_jax.tasks.things import Kit, Slot

__all__ = ["SLOT_REACH", "FoundSlot", "slot_of"]

SLOT_REACH = 0.01  # metres; a place that is no further from the middle of a slot is that slot


@dataclasses.dataclass(frozen=True)
class FoundSlot:
    """A slot in which an object was placed, on the average `off` [m] from its middle."""

    kit: Kit
    slot: Slot
    position: Vec3
    turn: float | None
    off: float

    @property
    def name(self) -> str:
        """As a target names it."""
        return f"{self.kit.name}.{self.slot.name}"


def slot_of(rows: Sequence[Observed], kits: Sequence[str], thing: Object, task: Task) -> FoundSlot | None:
    """Return the slot of one of the kits that placements of an object are in, the nearest; None if there is no such slot.

    It takes the object, and does not ask for another turn than they show; what is put on another object is in no slot. Twice
    what their scatter leaves open of the mean is not counted as distance.
    """
    stacked = [supports(one.action, one.thing, task)[0] in task.object_names for one in rows]
    if sum(stacked) > len(rows) / 2:
        return None
    found = []
    for kit in task.kits:
        if kit.name not in kits or not all(kit.name in one.action.poses for one in rows):
            continue
        points = np.array([one.handled(kit.name) for one in rows])
        shown = shown_turn(rows, kit.name, thing)
        doubt = 2 * float(np.linalg.norm(points.std(axis=0, ddof=1)[:2])) / len(rows) ** 0.5 if len(rows) > 1 else 0.0
        for slot in kit.places:
            position, turn = slot_position(kit, slot, thing), slot_turn(kit, slot, thing)
            off = points.mean(axis=0) - position
            near = np.linalg.norm(off[:2]) <= SLOT_REACH + doubt and abs(off[2]) <= task.episode.tolerance + doubt
            if near and fits(kit, slot, thing) and _alike(shown, turn, thing):
                found.append(FoundSlot(kit, slot, position, turn, float(np.linalg.norm(off[:2]))))
    return min(found, key=lambda one: one.off, default=None)


def _alike(shown: Turn | None, turn: float | None, thing: Object) -> bool:
    """Return whether a slot may mean the turn that was shown."""
    if shown is None or turn is None:
        return shown is None
    return bool(apart(np.array([shown.degrees]), turn, thing.symmetry)[0] <= 2 * REACH)
