"""Whether kits are valid: on their tables, apart, and with slots that lie in them."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator

from bt_jax.tasks.footprints import Footprint, overlap
from bt_jax.tasks.refusals import Fail
from bt_jax.tasks.slots import fits, slot_turn
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Kit, Slot, Table

__all__ = ["KIT_RULES", "check_kit_names"]

TOUCH = 1e-6  # metres by which rounded numbers may overlap


def check_kit_names(task: Task, fail: Fail) -> None:
    """Fail for a kit that cannot be built, or names what the task does not have."""
    tables = {table.name: table for table in task.tables}
    for i, kit in enumerate(task.kits):
        key = f"kits[{i}]"
        if kit.table and kit.table not in tables:
            fail(f"{key}.table", f"there is no table '{kit.table}'", f"use one of {', '.join(tables)}")
        if min(kit.inner) <= 0:
            fail(f"{key}.wall_thickness", "the walls leave no room", "make the walls thinner or the kit larger")
        if kit.dividers and kit.grid is None:
            fail(f"{key}.dividers", "there is no grid to divide", "add a grid, for instance grid: [2, 3]")
        _check_grid(kit, key, fail)
        _check_slot_names(task, i, fail)


def _check_on_tables(task: Task, fail: Fail) -> None:
    for i, kit in enumerate(task.kits):
        for table in _tables(task, kit):
            _check_table(kit, table, f"kits[{i}]", fail)


def _check_all_apart(task: Task, fail: Fail) -> None:
    for first, second in itertools.combinations(range(len(task.kits)), 2):
        _check_apart(task, first, second, fail)


def _tables(task: Task, kit: Kit) -> list[Table]:
    """Return the tables on which a kit may stand."""
    name = kit.table or task.layout.kit
    return [table for table in task.tables if name in ("random", table.name)]


def _check_grid(kit: Kit, key: str, fail: Fail) -> None:
    if kit.grid is None:
        return
    between = kit.wall_thickness if kit.dividers else 0.0
    if min(2 * kit.inner[1] / kit.grid[0], 2 * kit.inner[0] / kit.grid[1]) <= between:
        fail(f"{key}.grid", "the dividers leave no room", "use fewer rows and columns, or make the kit larger")


def _check_table(kit: Kit, table: Table, key: str, fail: Fail) -> None:
    if any(a > b for a, b in zip(kit.size, table.size, strict=False)):
        edges = " x ".join(f"{edge:g}" for edge in dict.fromkeys(kit.size))
        fail(f"{key}.size", f"{edges} m is wider than {table.name}", "make the kit smaller or the table larger")
    for at, half, edge in zip(kit.position, kit.half, table.size, strict=False):
        if abs(at) + half > edge / 2 + TOUCH:
            fail(f"{key}.position", f"{kit.name} would reach beyond the edge of {table.name}", "move it to the middle")


def _check_apart(task: Task, first: int, second: int, fail: Fail) -> None:
    one, other = task.kits[first], task.kits[second]
    on_same = [table.name for table in _tables(task, one) if table in _tables(task, other)]
    apart = [abs(a - b) - c - d for a, b, c, d in zip(one.position, other.position, one.half, other.half, strict=True)]
    if on_same and max(apart) < -TOUCH:
        problem = f"{other.name} would overlap {one.name} on {on_same[0]}"
        fail(f"kits[{second}].position", problem, "move one of them, or name another table")


def _check_slot_names(task: Task, number: int, fail: Fail) -> None:
    kit = task.kits[number]
    names = [slot.name for slot in kit.places]
    for j, slot in enumerate(kit.slots):
        key = f"kits[{number}].slots[{j}]"
        if not re.fullmatch(r"[\w-]+", slot.name):
            fail(f"{key}.name", f"'{slot.name}' is not a name", "use letters, digits, underscores and dashes")
        if names.count(slot.name) > 1:
            fail(f"{key}.name", f"two slots of {kit.name} are called '{slot.name}'", "rename one of them")
        if slot.takes and slot.takes not in task.instances:
            fail(f"{key}.for", f"there is no object '{slot.takes}'", f"use one of {', '.join(task.kinds)}")


def _check_slots(task: Task, fail: Fail) -> None:
    for i, kit in enumerate(task.kits):
        for j, slot in enumerate(kit.slots):
            _check_slot(task, kit, slot, f"kits[{i}].slots[{j}]", fail)


def _check_slot(task: Task, kit: Kit, slot: Slot, key: str, fail: Fail) -> None:
    if any(abs(at) > inner for at, inner in zip(slot.position, kit.inner, strict=True)):
        half = " and ".join(f"-{inner:.4g} to {inner:.4g}" for inner in kit.inner)
        fail(f"{key}.position", f"the slot is outside {kit.name}", f"write x and y from {half} m")
    if slot.takes and not any(True for _ in _filled(task, kit, slot)):
        thing, (x, y) = task.thing(slot.takes), kit.room(slot)
        problem = (
            f"{slot.takes} ({thing.measures}) does not fit in {2000 * x:.4g} x {2000 * y:.4g} mm between the walls"
        )
        fail(f"{key}.position", problem, f"move the slot away from the walls, turn it, or make {kit.name} larger")


def _check_slots_apart(task: Task, fail: Fail) -> None:
    for number, kit in enumerate(task.kits):
        for (i, one), (j, other) in itertools.combinations(enumerate(kit.slots), 2):
            if not _both_filled(task, kit, one, other):
                problem = f"the slots {one.name} and {other.name} of {kit.name} overlap"
                fail(f"kits[{number}].slots[{j}].position", problem, f"move it away from slots[{i}]")


def _both_filled(task: Task, kit: Kit, one: Slot, other: Slot) -> bool:
    """Return whether some objects may stand in two slots at a time; in a slot into which none fits, nothing does."""
    if math.dist(one.position, other.position) < TOUCH:
        return False
    ones, others = list(_filled(task, kit, one)), list(_filled(task, kit, other))
    pairs = [(a, b) for (name, a), (another, b) in itertools.product(ones, others) if name != another]
    return not pairs or any(overlap(a, b) <= TOUCH for a, b in pairs)


def _filled(task: Task, kit: Kit, slot: Slot) -> Iterator[tuple[str, Footprint]]:
    """Yield the objects that may stand in a slot, each with what it covers there."""
    for thing in task.objects:
        if fits(kit, slot, thing):
            yield thing.name, Footprint.of(thing, slot.position, slot_turn(kit, slot, thing) or 0.0)


KIT_RULES = (_check_on_tables, _check_all_apart, _check_slots, _check_slots_apart)
