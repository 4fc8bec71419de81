"""Where a base may stand: clear of the tables, and so that the arm reaches what the task asks for."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Sequence

from bt_jax.tasks.robot import Base
from bt_jax.tasks.support import added, kit_origin, resolve
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Table, Vec2, Vec3

__all__ = ["Wanted", "base_of", "in_reach", "is_free", "standing_places", "start_of", "wanted"]

CLEARANCE = 0.05  # metres between a computed standing place and where the base would touch a table
APART = 0.2  # metres at most between the places beside a table that are considered
MARGIN = 0.05  # metres by which the arm should reach beyond what it has to reach, where it can
SAMPLES = 9  # along each edge of a table on which objects start


@dataclasses.dataclass(frozen=True)
class Wanted:
    """A place that some station has to reach: the task's key that asks for it, what is there, and where that is."""

    key: str
    name: str
    point: Vec3


def base_of(task: Task) -> Base:
    """Return the base of a task whose robot drives."""
    assert task.robot.base is not None
    return task.robot.base


def start_of(task: Task) -> Vec2:
    """Return where the base starts: under the robot's frame."""
    return task.robot_position[:2]


def is_free(tables: Sequence[Table], point: Vec2, radius: float) -> bool:
    """Return whether a base does not touch any table where it stands, tables being enlarged along their edges."""
    return not any(
        all(abs(a - b) < edge / 2 + radius for a, b, edge in zip(point, table.position, table.size, strict=False))
        for table in tables
    )


def in_reach(task: Task, station: Vec2, point: Vec3, *, margin: float = 0.0) -> bool:
    """Return whether the arm reaches a point of the world from a station."""
    return math.dist((*station, task.robot_position[2]), point) <= base_of(task).reach - margin


def wanted(task: Task) -> Iterator[Wanted]:
    """Yield what has to be reached, wherever the kits are: the targets, as far as they are not on objects without a target,
    fixed objects, and the tables on which others start."""
    kit_tables = [table for table in task.tables if task.layout.kit in ("random", table.name)] or list(task.tables)
    for i, target in enumerate(task.targets):
        root, position = resolve(task, target)
        key = f"targets[{i}].{'slot' if target.slot else 'position'}"
        if root in task.kit_names:
            for table in kit_tables:
                yield Wanted(key, target.object, added(kit_origin(task, table, root), position))
        elif root == task.robot_frame:
            yield Wanted(key, target.object, added(task.robot_position, position))
    for i, place in enumerate(task.layout.fixed):
        yield Wanted(f"layout.fixed[{i}].position", place.object, added(task.robot_position, place.position))
    named = {kit.table for kit in task.kits if kit.table}
    if any(not kit.table for kit in task.kits) and task.layout.kit != "random":
        named.add(task.layout.kit)
    loose = [thing for thing in task.objects if thing.name not in [place.object for place in task.layout.fixed]]
    for table in task.tables if loose else ():
        if table.name not in named:
            height = table.top + max(thing.height for thing in loose) / 2
            half = [max(0.0, edge / 2 - task.layout.margin) for edge in table.size[:2]]
            shares = [2 * i / (SAMPLES - 1) - 1 for i in range(SAMPLES)]
            for x, y in itertools.product(shares, shares):
                point = table.position[0] + x * half[0], table.position[1] + y * half[1], height
                yield Wanted("", table.name, point)


@functools.lru_cache(maxsize=16)
def standing_places(task: Task) -> tuple[Vec2, ...]:
    """Return the stations of a task or, where none are given, places beside the tables from which the arm reaches all that
    is wanted, as far as it can: again and again the place that adds most, the nearest of equals (greedy set cover)."""
    base = base_of(task)
    if base.stations:
        return base.stations
    places = [
        place for table in task.tables for place in _beside(table, base) if is_free(task.tables, place, base.radius)
    ]
    points = list(dict.fromkeys(one.point for one in wanted(task)))
    chosen: list[Vec2] = []
    for margin in (MARGIN, 0.0):
        reached = {
            place: {point for point in points if in_reach(task, place, point, margin=margin)} for place in places
        }
        missing = set(points).difference(*(reached[place] for place in chosen))
        while missing and (best := _best(reached, missing)) is not None:
            chosen.append(best)
            missing -= reached[best]
    return tuple(chosen)


def _best(reached: dict[Vec2, set[Vec3]], missing: set[Vec3]) -> Vec2 | None:
    """Return the place that reaches most of what is missing, None if none reaches any."""

    def worth(place: Vec2) -> tuple[int, float]:
        new = reached[place] & missing
        return len(new), -sum((math.dist(place, point[:2]) for point in sorted(new)), 0.0)

    best = max(reached, key=worth, default=None)
    return best if best is not None and reached[best] & missing else None


def _beside(table: Table, base: Base) -> Iterator[Vec2]:
    """Yield places along the four sides of a table."""
    for axis, side in itertools.product((0, 1), (-1, 1)):
        away = table.position[axis] + side * (table.size[axis] / 2 + base.radius + CLEARANCE)
        edge, middle = table.size[1 - axis], table.position[1 - axis]
        pieces = max(2, 2 * math.ceil(edge / APART / 2))  # an even number, so that the middle is one
        for i in range(pieces + 1):
            along = middle + edge * (i / pieces - 0.5)
            yield (away, along) if axis == 0 else (along, away)
