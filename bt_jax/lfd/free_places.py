"""Places that nothing can occupy in any layout of a task, to put objects out of the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from bt_jax.behaviors import Behavior, gene_pool
from bt_jax.lfd.extents import Extent, block_at, half_of, kit_extents, kit_tables, place_extents, start_extents, turn_at
from bt_jax.lfd.fingers import grasps, hit, walls
from bt_jax.lfd.placements import target_of
from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import about_vertical, added, kit_origin, resolve, start_turn
from bt_jax.tasks.things import Vec3

__all__ = ["free_places", "on_floor"]

ROUNDING = 1e-6  # metres


def free_places(task: Task, names: Sequence[str]) -> dict[str, Target]:
    """Return a free place for each of some objects, as far as there are any: in a kit, among those of the gene pool, or
    else on a table, in the robot's frame. It is the roomiest, the first of equals, and at least `genes.gap` and the room of
    a finger away from the other free places, from where objects may start, and from all targets. Objects that the others
    leave no place choose before them."""
    moves = [gene for gene in gene_pool(task).leaves if gene.name in ("move", "carry")] if names else []
    order, found = list(names), _in_order(task, moves, names)
    for _ in range(len(names) - 1):
        first = [name for name in order if name not in found]
        again = [*first, *(name for name in order if name in found)]
        if again == order or len(other := _in_order(task, moves, again)) <= len(found):
            break
        order, found = again, other
    return found


def on_floor(task: Task, place: Target) -> bool:
    """Return whether an object at a place lies on the floor of a kit, so that nothing has to be there before it."""
    kit = next((kit for kit in task.kits if kit.name == place.frame), None)
    height = task.thing(place.object).height
    return kit is not None and abs(place.position[2] - kit.plate - height / 2) < task.episode.tolerance


def _in_order(task: Task, moves: Sequence[Behavior], names: Sequence[str]) -> dict[str, Target]:
    """Return a free place for each of some objects, those of the first chosen first."""
    found: dict[str, Target] = {}
    least = max(task.genes.gap, task.finger_room) - ROUNDING
    for name in names:
        taken = [(table, _taken(task, name, table, found.values())) for table in kit_tables(task)]
        for places in (_in_kits(task, moves, name), _on_tables(task, name)):
            room = {place: _room(task, place, taken) for place in places}
            best = max(room, key=lambda place: room[place], default=None)
            if best is not None and room[best] >= least:
                found[name] = best
                break
    return found


def _in_kits(task: Task, moves: Iterable[Behavior], name: str) -> Iterator[Target]:
    """Yield the gene pool's places for an object in a kit at which it can lie there, and be taken from there again."""
    thing, kits = task.thing(name), {kit.name: kit for kit in task.kits}
    for gene in moves:
        kit = kits.get(str(gene.frame))
        if kit is None or gene.position is None or gene.object != (thing.part or name):
            continue
        place = target_of(Behavior("at", (name, *gene.args[1:])))
        if on_floor(task, place) and _inside(_carried(task, place), place, (0.0, 0.0), kit.inner) and any(
            not any(hit(fingers, wall) for wall in walls(kit, (0.0, 0.0, 0.0)))
            for fingers in grasps(task, name, place.position, turn_at(task, place))
        ):  # fmt: skip
            yield place


def _on_tables(task: Task, name: str) -> Iterator[Target]:
    """Yield the places of a lattice on every table."""
    thing = task.thing(name)
    turns: tuple[float | None, ...] = (None,)
    if thing.symmetry and (thing.symmetry == 180 or start_turn(task, name) is None):
        turns = (0.0, 90.0) if thing.symmetry == 180 else (0.0,)
    for table in task.tables:
        for turn in turns:
            half = thing.half_at(turn)
            across, along = (_lattice(table.size[i], 2 * half[i], task.genes.gap) for i in (0, 1))
            for x in across:
                for y in along:
                    world = (table.position[0] + x, table.position[1] + y, table.top + half[2])
                    place = Target(name, _in_frame(world, task.robot_position), task.robot_frame, turn)
                    middle = _in_frame(table.position, task.robot_position)[:2]
                    if _inside(_carried(task, place), place, middle, (table.size[0] / 2, table.size[1] / 2)):
                        yield place


def _lattice(edge: float, size: float, gap: float) -> list[float]:
    """Return where blocks stand side by side along an edge, from its middle."""
    far = (edge - size) / 2
    count = 1 + int(2 * far / (size + gap)) if far > 0 else 1
    return np.linspace(-far, far, count).tolist() if count > 1 else [0.0]


def _inside(carried: list[Extent], place: Target, middle: tuple[float, float], half: tuple[float, float]) -> bool:
    """Return whether all that comes to lie around a place lies within a rectangle of its frame."""
    x, y = place.position[0] - middle[0], place.position[1] - middle[1]
    return all(
        abs(x + part.x) + part.half_x <= half[0] + ROUNDING and abs(y + part.y) + part.half_y <= half[1] + ROUNDING
        for part in carried
    )


def _carried(task: Task, place: Target) -> list[Extent]:
    """Return what an object at a place in a kit or on a table, and those whose targets are in its frame, fill, from its
    centre. An object that has a target itself is alone until it is there."""
    name, turn = place.object, turn_at(task, place)
    found = [block_at((0.0, 0.0, 0.0), half_of(task, name, turn))]
    for target in task.targets:
        root, offset = resolve(task, target)
        if root == name:
            half = half_of(task, target.object, turn_at(task, target) if turn == start_turn(task, name) else None)
            if turn is None:
                around = math.hypot(offset[0], offset[1])
                found.append(block_at((0.0, 0.0, offset[2]), (half[0] + around, half[1] + around, half[2])))
            else:
                found.append(block_at(about_vertical(offset, turn), half))
    return found


def _taken(task: Task, name: str, table: Table, others: Iterable[Target]) -> list[Extent]:
    """Return what may be filled while the kits are on a table, apart from an object and those in its frame: by objects where
    they start, at their targets, and at their own free places."""
    found = [extent for other in task.object_names if other != name for extent in start_extents(task, other, table)]
    for target in task.targets:
        found += place_extents(task, target, table) if resolve(task, target)[0] != name else []
    for place in others:
        found += _filled(task, place, _carried(task, place), table)
    return found


def _room(task: Task, place: Target, taken: list[tuple[Table, list[Extent]]]) -> float:
    """Return how far a place is away from everything that may be near it."""
    nearest, carried = math.inf, _carried(task, place)
    for table, others in taken:
        kits = [extent for name, extent in kit_extents(task, table).items() if place.frame != name]
        parts = _filled(task, place, carried, table)
        nearest = min([nearest, *(part.gap(other) for part in parts for other in (*others, *kits))])
    return nearest


def _filled(task: Task, place: Target, carried: list[Extent], table: Table) -> list[Extent]:
    """Return what comes to lie around a place while the kits are on a table."""
    origin = kit_origin(task, table, place.frame) if place.frame in task.kit_names else task.robot_position
    x, y, _ = added(origin, place.position)
    return [Extent(x + part.x, y + part.y, part.half_x, part.half_y, part.bottom, part.top) for part in carried]


def _in_frame(point: Vec3, origin: Vec3) -> Vec3:
    x, y, z = (round(float(a - b), 4) + 0.0 for a, b in zip(point, origin, strict=True))
    return x, y, z
