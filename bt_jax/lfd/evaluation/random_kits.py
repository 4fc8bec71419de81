"""Tasks made by computer with objects of several shapes, parts, slots and two trays."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from bt_jax.tasks import Layout, Target, Task
from bt_jax.tasks.checks import check, check_support
from bt_jax.tasks.slots import fits, slot_position, slot_turn
from bt_jax.tasks.support import added, kit_origin
from bt_jax.tasks.things import Kit, Object, Slot, Table, Vec2, Vec3

__all__ = ["random_kit_task"]

FORMS = (
    Object("Plate", (0.18, 0.1, 0.03), (0.2, 0.45, 0.75)),
    Object("Bar", (0.2, 0.04, 0.04), (0.85, 0.45, 0.15)),
    Object("Can", (0.07, 0.07, 0.1), (0.75, 0.15, 0.15), shape="cylinder"),
    Object("Block", (0.08, 0.08, 0.08), (0.95, 0.75, 0.1)),
)
PARTS = (
    Object("Bolt", (0.04, 0.04, 0.06), (0.6, 0.62, 0.66), shape="cylinder", part="Bolt"),
    Object("Brick", (0.08, 0.04, 0.04), (0.55, 0.35, 0.7), part="Brick"),
)
COUNTS = (2, 3, 4)  # how many instances a part has
PART, SLOT_FOR, ONE_TABLE, FILLED, NEIGHBOR, STACKED = 0.5, 0.5, 0.6, 0.25, 0.4, 0.3  # how often there is such a thing
IN_SLOT, ON_TOP = 0.6, 0.3  # how often a target is in a slot, or on another object
START_TURNS, SLOT_TURNS, TURNS = (0.0, 30.0, 180.0), (0.0, 30.0, 90.0), (None, 0.0, 30.0, 90.0)  # degrees
CELL = 0.22  # a square in which every object fits however it is turned, metres
CLOSE = 0.01  # metres between neighbors, too little for a finger
SPOTS = ((-0.3, -0.2), (0.3, -0.2))  # of targets and fixed objects beside the trays, seen from the table's middle


def random_kit_task(task: Task, *, objects: int, rng: np.random.Generator) -> Task:
    """Return a task with this many objects, at most a dozen, on the tables of another, which has at least three. Its
    episodes have the ticks to move each object twice."""
    things = _things(objects, rng)
    named = task.tables[rng.integers(len(task.tables))].name if rng.random() < ONE_TABLE else ""
    trays = (
        Kit(
            "TrayA",
            (3 * CELL + 0.04, 0.3),
            wall_height=0.02,
            table=named,
            position=(0.0, 0.15),
            slots=_slots(things, rng),
        ),
        Kit("TrayB", (CELL, CELL), wall_height=0.02, table=named, position=(0.0, -0.2), grid=(2, 2), dividers=True),
    )
    empty = dataclasses.replace(
        task, name="random_kit", description="", objects=things, kits=trays, targets=(), subgoals=(),
        layout=dataclasses.replace(task.layout, kit="random", stack=(), fixed=(), turn=float(rng.choice(START_TURNS))),
        episode=dataclasses.replace(task.episode, max_ticks=2 * 2 * objects + task.episode.success_ticks),
    )  # fmt: skip
    table = next((one for one in task.tables if one.name == named), None)
    layout = _layout(empty, table, rng)
    targets = _targets(dataclasses.replace(empty, layout=layout), table, rng)
    made = dataclasses.replace(empty, layout=layout, targets=tuple(targets[i] for i in rng.permutation(len(targets))))
    check(made, "random task")
    check_support(made, "random task")
    return made


def _things(count: int, rng: np.random.Generator) -> tuple[Object, ...]:
    """Return objects of random forms, some of them instances of a part."""
    found: list[Object] = []
    parts = [PARTS[i] for i in rng.permutation(len(PARTS))]
    while len(found) < count:
        if parts and rng.random() < PART:
            one = parts.pop()
            found += [dataclasses.replace(one, name=f"{one.part}{i + 1}") for i in range(int(rng.choice(COUNTS)))]
        else:
            one = FORMS[rng.integers(len(FORMS))]
            found.append(dataclasses.replace(one, name=f"{one.name}{sum(one.size == it.size for it in found) + 1}"))
    return tuple(found[:count])


def _slots(things: Sequence[Object], rng: np.random.Generator) -> tuple[Slot, ...]:
    """Return three slots in a row, two of them perhaps for one kind of thing or turned; anything fits in the last."""
    chosen = [things[i] for i in rng.integers(len(things), size=3)]
    takes = [(one.part or one.name) if rng.random() < SLOT_FOR else "" for one in chosen[:2]]
    turns = rng.choice(SLOT_TURNS, size=2)
    kinds = [*zip(map(float, turns), takes, strict=True), (0.0, "")]
    return tuple(Slot(f"s{i + 1}", (round((i - 1) * CELL, 6), 0.0), *kind) for i, kind in enumerate(kinds))


def _layout(task: Task, table: Table | None, rng: np.random.Generator) -> Layout:
    """Return where objects start: some in slots and beside the trays, where these have one table, and a stack of cubes."""
    fixed: list[Target] = []
    left = [task.objects[i] for i in rng.permutation(len(task.objects))]
    if table is not None:
        places = [(kit, dataclasses.replace(slot, takes="")) for kit in task.kits for slot in kit.places]
        for kit, slot in places:
            if left and rng.random() < FILLED and fits(kit, slot, left[-1]):
                thing = left.pop()
                here = added(kit_origin(task, table, kit.name), slot_position(kit, slot, thing))
                fixed.append(Target(thing.name, _seen(task, here), task.robot_frame, slot_turn(kit, slot, thing)))
        for x, y in SPOTS:
            if left and rng.random() < FILLED:
                thing = left.pop()
                fixed.append(_at_spot(thing, (x, y), task, table))
                # One of two neighbors can be taken from its ends, and is not where it cannot be taken from any more.
                narrow = any(one.size[0] <= task.gripper_opening for one in (thing, *left[-1:]))
                if left and rng.random() < NEIGHBOR and narrow and not thing.part:
                    beside = y + thing.half_at(None)[1] + left[-1].half_at(None)[1] + CLOSE
                    fixed.append(_at_spot(left.pop(), (x, beside), task, table))
                elif left and rng.random() < NEIGHBOR and _carries(thing, left[-1]):
                    raised = _at_spot(left.pop(), (x, y), task, table)
                    x, y, z = raised.position
                    fixed.append(dataclasses.replace(raised, position=(x, y, round(z + thing.height, 6))))
    blocks = [thing.name for thing in left if thing.is_cube]
    stack = tuple(blocks) if len(blocks) > 1 and rng.random() < STACKED else ()
    return dataclasses.replace(task.layout, fixed=tuple(fixed), stack=stack)


def _targets(task: Task, table: Table | None, rng: np.random.Generator) -> list[Target]:
    """Return places that are free of each other, for some of the objects."""
    spots = list(SPOTS) if table is not None else []
    slots = [(kit, kit.places[i]) for kit in task.kits for i in rng.permutation(len(kit.places))]
    chosen = [task.objects[i] for i in rng.permutation(len(task.objects))][: rng.integers(1, len(task.objects) + 1)]
    loose = [thing for thing in task.objects if thing not in chosen and not thing.part]
    targets: list[Target] = []
    tops = [thing for thing in loose if thing.name not in task.layout.stack]
    for thing in chosen:
        name = thing.part or thing.name
        free = [(kit, slot) for kit, slot in slots if fits(kit, slot, thing)]
        below = next((one for one in tops if _carries(one, thing)), None)
        if below is not None and rng.random() < ON_TOP:
            tops.remove(below)
            targets.append(Target(name, (0.0, 0.0, round((below.height + thing.height) / 2, 6)), below.name))
        elif free and (rng.random() < IN_SLOT or not spots):
            kit, slot = free[rng.integers(len(free))]
            slots.remove((kit, slot))
            place = slot_position(kit, slot, thing)
            targets.append(Target(name, place, kit.name, slot_turn(kit, slot, thing), f"{kit.name}.{slot.name}"))
            if thing.part or kit is not task.kits[0]:
                continue
        elif spots and table is not None:
            turn = TURNS[rng.integers(len(TURNS))] if thing.symmetry == 180 else None
            targets.append(_at_spot(thing, spots.pop(rng.integers(len(spots))), task, table, turn, name))
        else:
            continue
        if not thing.part:
            tops.append(thing)
    return targets


def _carries(below: Object, above: Object) -> bool:
    """Return whether an object stays on the middle of another however both are turned."""
    return max(above.half_at(None)[:2]) < 2 * min(below.half_at(None)[:2])


def _at_spot(thing: Object, spot: Vec2, task: Task, table: Table, turn: float | None = None, name: str = "") -> Target:
    """Return a place beside the trays, in the robot's frame."""
    here = table.position[0] + spot[0], table.position[1] + spot[1], table.top + thing.height / 2
    return Target(name or thing.name, _seen(task, here), task.robot_frame, turn)


def _seen(task: Task, point: Vec3) -> Vec3:
    """Return a point of the world in the robot's frame."""
    x, y, z = (round(float(a - b), 6) + 0.0 for a, b in zip(point, task.robot_position, strict=True))
    return x, y, z
