"""Trays of a kit, and their slots, that a person adds, copies, removes, names, sizes and moves. Lengths are metres.

What cannot be is refused with a UserError, and what can be shown but not done is left to `bt_jax.tasks.problems`.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax.app.state.kit.objects import in_slots
from bt_jax.app.state.kit.references import check_name, check_numbers, stem_of, taken_names, unused_name, with_names
from bt_jax.tasks import Kit, Slot, Task
from bt_jax.tasks.checks import MOST_KITS
from bt_jax.tasks.things import Vec2

__all__ = [
    "add_slot",
    "add_tray",
    "change_slot",
    "change_tray",
    "copy_tray",
    "remove_slot",
    "remove_tray",
    "rename_tray",
]

ROOM = 0.02  # metres between a new tray and those that are there
SIZES = (0.5, 0.4, 0.3, 0.25)  # of a new tray, as parts of the smallest table: the first for which there is room


def add_tray(task: Task) -> tuple[Task, str]:
    """Return the task with one more tray, and its name."""
    edge = min(min(table.size[:2]) for table in task.tables)
    plain = dataclasses.replace(task.kits[-1], table="", slots=(), grid=None, dividers=False)
    trays = [dataclasses.replace(plain, size=(round(part * edge, 2),) * 2) for part in SIZES]
    return _with_tray(task, next((tray for tray in trays if _free(task, tray) is not None), trays[-1]), "Tray")


def copy_tray(task: Task, name: str) -> tuple[Task, str]:
    """Return the task with another tray like one that it has, and its name."""
    return _with_tray(task, tray_of(task, name), stem_of(name))


def remove_tray(task: Task, name: str) -> Task:
    """Return the task without a tray and the targets in it. Raise UserError if there would be none left."""
    left = tuple(kit for kit in task.kits if kit.name != name)
    if not left:
        raise UserError(f"{name} is the only tray; add another one first")
    return with_names(dataclasses.replace(task, kits=left), {name: None}, {})


def rename_tray(task: Task, name: str, new: str) -> Task:
    """Return the task in which a tray is called otherwise."""
    check_name(task, new, name)
    kits = tuple(dataclasses.replace(kit, name=new) if kit.name == name else kit for kit in task.kits)
    return with_names(dataclasses.replace(task, kits=kits), {name: new}, {})


def change_tray(task: Task, name: str, /, **fields: Any) -> Task:
    """Return the task with other values of some fields of a tray. Raise UserError if it could not be built."""
    kit = dataclasses.replace(tray_of(task, name), **fields)
    if min(kit.inner) <= 0:
        raise UserError(f"the walls of {name} leave no room; make it larger")
    if kit.grid is not None and min(kit.grid) < 1:
        raise UserError("a grid has one row and one column at least; write 1 or more, or leave both empty")
    if kit.grid is None:
        kit = dataclasses.replace(kit, dividers=False)
    elif kit.dividers and min(2 * kit.inner[1] / kit.grid[0], 2 * kit.inner[0] / kit.grid[1]) <= kit.wall_thickness:
        raise UserError(f"the dividers of {name} leave no room; use fewer rows and columns, or make it larger")
    names = [slot.name for slot in kit.places]
    twice = next((one for one in names if names.count(one) > 1), None)
    if twice is not None:
        raise UserError(f"{name} has a slot {twice} already; choose another name")
    return check_numbers(in_slots(_with(task, kit)))


def add_slot(task: Task, name: str, position: Vec2) -> tuple[Task, str]:
    """Return the task with one more slot at a place in a tray, and the slot's name."""
    kit = tray_of(task, name)
    taken = {slot.name for slot in kit.places}
    called = next(f"s{n}" for n in itertools.count(1) if f"s{n}" not in taken)
    slot = Slot(called, (round(position[0], 4), round(position[1], 4)))
    return change_tray(task, name, slots=(*kit.slots, slot)), called


def change_slot(task: Task, name: str, slot: str, /, **fields: Any) -> Task:
    """Return the task with other values of some fields of a slot that is not of a grid; targets in it follow."""
    kit = tray_of(task, name)
    slots = tuple(dataclasses.replace(one, **fields) if one.name == slot else one for one in kit.slots)
    new = fields.get("name", slot)
    if not re.fullmatch(r"[\w-]+", new):
        raise UserError(f"'{new}' is not a name; use letters, digits, underscores and dashes")
    targets = tuple(
        dataclasses.replace(one, slot=f"{name}.{new}") if one.slot == f"{name}.{slot}" else one for one in task.targets
    )
    return change_tray(dataclasses.replace(task, targets=targets), name, slots=slots)


def remove_slot(task: Task, name: str, slot: str) -> Task:
    """Return the task without a slot; what should be in it should be there still."""
    return change_tray(task, name, slots=tuple(one for one in tray_of(task, name).slots if one.name != slot))


def tray_of(task: Task, name: str) -> Kit:
    """Return the tray with a name."""
    return next(kit for kit in task.kits if kit.name == name)


def _with(task: Task, kit: Kit) -> Task:
    return dataclasses.replace(task, kits=tuple(kit if one.name == kit.name else one for one in task.kits))


def _with_tray(task: Task, kit: Kit, stem: str) -> tuple[Task, str]:
    """Return the task with one more tray like this, beside those on the same table if there is room, and its name."""
    if len(task.kits) >= MOST_KITS:
        raise UserError(f"{len(task.kits) + 1} trays are too many; use {MOST_KITS} or fewer")
    name = unused_name(stem, taken_names(task))
    new = dataclasses.replace(kit, name=name, position=_free(task, kit) or (0.0, 0.0))
    return dataclasses.replace(task, kits=(*task.kits, new)), name


def _free(task: Task, kit: Kit) -> Vec2 | None:
    """Return the place nearest to the middle of its table where a tray overlaps no other, None if there is none."""
    table = min((one for one in task.tables if kit.table in ("", one.name)), key=lambda one: min(one.size[:2]))
    others = [one for one in task.kits if one.table == kit.table]
    span = [max(0.0, edge / 2 - half) for edge, half in zip(table.size[:2], kit.half, strict=True)]
    steps = range(-20, 21)
    places = [(round(span[0] * i / 20, 3), round(span[1] * j / 20, 3)) for i in steps for j in steps]

    def is_free(place: Vec2) -> bool:
        return all(
            any(
                abs(a - b) >= half + beyond + ROOM / 2
                for a, b, half, beyond in zip(place, one.position, kit.half, one.half, strict=True)
            )
            for one in others
        )

    return min(filter(is_free, places), key=lambda place: place[0] ** 2 + place[1] ** 2, default=None)
