"""Places that nothing can occupy in any layout of a task, to put boxes out of the way."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np

from bt_jax.behaviors import gene_pool
from bt_jax.lfd.extents import Extent, box_at, kit_extent, kit_tables, place_extents, start_extents
from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import kit_origin, resolve
from bt_jax.tasks.things import Vec3

__all__ = ["free_places"]

ROUNDING = 1e-6  # metres


def free_places(task: Task, boxes: Iterable[str]) -> dict[str, Target]:
    """Return a free place for each of some boxes, as far as there are any: in the kit, among those of the gene pool, or else
    on a table, in the robot's frame. It is the roomiest, the first of equals, and at least `genes.gap` away from the other
    free places, from where boxes may start, and from all targets."""
    found: dict[str, Target] = {}
    for name in boxes:
        carried = _carried(task, name)
        taken = [(table, _taken(task, name, table, found.values())) for table in kit_tables(task)]
        for places in (_in_kit(task, carried, name), _on_tables(task, carried, name)):
            room = {place: _room(task, place, carried, taken) for place in places}
            best = max(room, key=lambda place: room[place], default=None)
            if best is not None and room[best] >= task.genes.gap - ROUNDING:
                found[name] = best
                break
    return found


def _in_kit(task: Task, carried: list[Extent], name: str) -> Iterator[Target]:
    """Yield the gene pool's places for a box in the kit at which it can lie there."""
    low, inner = (task.kit.thickness + task.edge(name)) / 2, task.kit.inner[0]
    for gene in gene_pool(task).leaves:
        if gene.name == "move" and gene.object == name and gene.frame == task.kit.name and gene.position is not None:
            place = Target(name, gene.position, task.kit.name)
            lies = abs(gene.position[2] - low) < task.episode.tolerance
            if lies and _inside(carried, place, (0.0, 0.0), inner, inner):
                yield place


def _on_tables(task: Task, carried: list[Extent], name: str) -> Iterator[Target]:
    """Yield the places of a lattice on every table."""
    size = task.edge(name)
    for table in task.tables:
        across, along = (_lattice(edge, size, task.genes.gap) for edge in table.size[:2])
        for x in across:
            for y in along:
                world = (table.position[0] + x, table.position[1] + y, table.top + size / 2)
                place = Target(name, _in_frame(world, task.robot_position), task.robot_frame)
                middle = _in_frame(table.position, task.robot_position)[:2]
                if _inside(carried, place, middle, table.size[0] / 2, table.size[1] / 2):
                    yield place


def _lattice(edge: float, size: float, gap: float) -> list[float]:
    """Return where boxes stand side by side along an edge, from its middle."""
    far = (edge - size) / 2
    count = 1 + int(2 * far / (size + gap)) if far > 0 else 1
    return np.linspace(-far, far, count).tolist() if count > 1 else [0.0]


def _inside(carried: list[Extent], place: Target, middle: tuple[float, float], half_x: float, half_y: float) -> bool:
    """Return whether all that comes to lie around a place lies within a rectangle of its frame."""
    x, y = place.position[0] - middle[0], place.position[1] - middle[1]
    return all(
        abs(x + part.x) + part.half_x <= half_x + ROUNDING and abs(y + part.y) + part.half_y <= half_y + ROUNDING
        for part in carried
    )


def _carried(task: Task, name: str) -> list[Extent]:
    """Return what a box and those whose targets are in its frame fill, from its centre. A box that has a target itself is
    alone until it is there."""
    found = [box_at((0.0, 0.0, 0.0), task.edge(name))]
    for target in task.targets:
        root, offset = resolve(task, target)
        if root == name:
            found.append(box_at(offset, task.edge(target.object)))
    return found


def _taken(task: Task, name: str, table: Table, others: Iterable[Target]) -> list[Extent]:
    """Return what may be filled while the kit is on a table, apart from a box and those in its frame: by boxes where they
    start, at their targets, and at their own free places."""
    found = [extent for other in task.object_names if other != name for extent in start_extents(task, other, table)]
    for target in task.targets:
        found += place_extents(task, target, table) if resolve(task, target)[0] != name else []
    for place in others:
        found += _filled(task, place, _carried(task, place.object), table)
    return found


def _room(task: Task, place: Target, carried: list[Extent], taken: list[tuple[Table, list[Extent]]]) -> float:
    """Return how far a place is away from everything that may be near it."""
    nearest = math.inf
    for table, others in taken:
        kit = [] if place.frame == task.kit.name else [kit_extent(task, table)]
        parts = _filled(task, place, carried, table)
        nearest = min([nearest, *(part.gap(other) for part in parts for other in (*others, *kit))])
    return nearest


def _filled(task: Task, place: Target, carried: list[Extent], table: Table) -> list[Extent]:
    """Return what comes to lie around a place while the kit is on a table."""
    origin = kit_origin(task, table) if place.frame == task.kit.name else task.robot_position
    x, y = origin[0] + place.position[0], origin[1] + place.position[1]
    return [Extent(x + part.x, y + part.y, part.half_x, part.half_y, part.bottom, part.top) for part in carried]


def _in_frame(point: Vec3, origin: Vec3) -> Vec3:
    x, y, z = (round(float(a - b), 4) + 0.0 for a, b in zip(point, origin, strict=True))
    return x, y, z
