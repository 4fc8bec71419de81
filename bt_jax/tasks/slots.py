"""How objects stand in the slots of a kit."""

from __future__ import annotations

from bt_jax.tasks.things import Kit, Object, Slot, Vec3

__all__ = ["fits", "slot_position", "slot_turn"]


def slot_position(kit: Kit, slot: Slot, thing: Object) -> Vec3:
    """Return where the centre of an object is that stands in a slot, in the kit's frame."""
    x, y = slot.position
    return x, y, round(kit.plate + thing.height / 2, 6)


def slot_turn(slot: Slot, thing: Object) -> float | None:
    """Return how an object lies in a slot, degrees; None where all turns are alike or a cube's is not asked for."""
    turn = slot.turn % thing.symmetry if thing.symmetry else 0.0
    return turn if thing.symmetry == 180 or turn else None


def fits(kit: Kit, slot: Slot, thing: Object) -> bool:
    """Return whether an object may stand in a slot: it is for the object, its part or any, and it is wide enough."""
    if slot.takes not in ("", thing.name, thing.part):
        return False
    half = thing.half_at(slot_turn(slot, thing))
    return all(edge <= room for edge, room in zip(half[:2], kit.room(slot), strict=True))
