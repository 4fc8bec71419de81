"""How objects stand in the slots of a kit."""

from __future__ import annotations

from collections.abc import Iterable

from bt_jax.tasks.things import Kit, Object, Slot, Vec2, Vec3

__all__ = ["fits", "slot_position", "slot_turn", "slots_by_name"]


def slots_by_name(kits: Iterable[Kit]) -> dict[str, tuple[Kit, Slot]]:
    """Return all slots of kits by the names that tasks give them, such as "TrayA.a1"."""
    return {f"{kit.name}.{slot.name}": (kit, slot) for kit in kits for slot in kit.places}


def slot_position(kit: Kit, slot: Slot, thing: Object) -> Vec3:
    """Return where the centre of an object is that stands in a slot, in the kit's frame."""
    x, y = slot.position
    return x, y, round(kit.plate + thing.height / 2, 6)


def slot_turn(kit: Kit, slot: Slot, thing: Object) -> float | None:
    """Return how an object lies in a slot, degrees; None where any turn will do: that of a cylinder, or of what stands on a
    square and has room for every turn, unless the slot is turned."""
    if not thing.symmetry:
        return None
    turn = slot.turn % thing.symmetry
    return None if thing.symmetry == 90 and not turn and thing.reach <= min(_own_room(kit, slot)) else turn


def _own_room(kit: Kit, slot: Slot) -> Vec2:
    """Return half the widths of what is free around the middle of a slot: between the walls and, in a grid, in its cell."""
    (x, y), inner = kit.room(slot), kit.inner
    if kit.grid is None or slot in kit.slots:
        return x, y
    rows, columns = kit.grid
    return min(x, inner[0] / columns), min(y, inner[1] / rows)


def fits(kit: Kit, slot: Slot, thing: Object) -> bool:
    """Return whether an object may stand in a slot: it is for the object, its part or any, and it is wide enough."""
    if slot.takes not in ("", thing.name, thing.part):
        return False
    half = thing.half_at(slot_turn(kit, slot, thing))
    return all(edge <= room for edge, room in zip(half[:2], kit.room(slot), strict=True))
