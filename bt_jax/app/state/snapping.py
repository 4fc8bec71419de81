"""Slots close to where a person drops an object: it is moved into the slot, and turned as it lies there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from bt_jax.app.state.extents import Point, heading, inside, poses_now, turned
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Kit, Object, Slot, Task
from bt_jax.tasks.slots import fits, slot_position, slot_turn

__all__ = ["SNAP", "Snapped", "catch_radius", "slot_near", "snapped"]

SNAP = 0.25  # what is this near, in sizes of its object, to a place of note is moved there
CATCH = 0.35  # and to a slot, in distances to the next slot


@dataclasses.dataclass(frozen=True, eq=False)
class Snapped:
    """A place in a slot [m, world]; `turn` is in degrees, None where the object stays as it lies; `slot` says which, as in
    "slot a1 of TrayA"."""

    position: Point
    turn: float | None
    slot: str


def slot_near(kit: Kit, thing: Object, local: Point) -> Slot | None:
    """Return the slot that a place in a kit is close to, None if there is none that takes the object."""
    places = [slot for slot in kit.places if fits(kit, slot, thing)]
    if not places or not -thing.height / 4 < local[2] - kit.plate - thing.height / 2 < kit.wall_height:
        return None
    best = min(places, key=lambda slot: math.dist(slot.position, local[:2]))
    return best if math.dist(best.position, local[:2]) <= catch_radius(kit, best, thing) else None


def catch_radius(kit: Kit, slot: Slot, thing: Object) -> float:
    """Return how far [m] from the middle of a slot an object may be dropped that is then moved into it."""
    others = [math.dist(other.position, slot.position) for other in kit.places if other is not slot]
    return max(SNAP * max(thing.size[:2]), CATCH * min(others, default=min(kit.half)))


def snapped(task: Task, world: World, name: str, position: Point) -> Snapped | None:
    """Return where an object stands that is dropped close to a free slot, None if it is dropped elsewhere. `world` is a
    batch of one (NumPy)."""
    now, thing = poses_now(task, world), task.thing(name)
    for kit, origin in zip(task.kits, np.asarray(world.kits[0], float), strict=True):
        slot = slot_near(kit, thing, position - origin)
        if slot is None:
            continue
        turn, place = slot_turn(kit, slot, thing), origin + slot_position(kit, slot, thing)
        pose = turned(place, heading(now[name]) if turn is None else turn)
        if not any(inside(task, name, pose, other, at) for other, at in now.items() if other != name):
            return Snapped(place, turn, f"slot {slot.name} of {kit.name}")
    return None
