"""Where boxes may be in the layouts of a task, before any layout is seen: upright blocks in the world [m]."""

from __future__ import annotations

import dataclasses
import math

from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import kit_origin, resolve
from bt_jax.tasks.things import Vec3

__all__ = ["Extent", "box_at", "kit_extent", "kit_tables", "place_extents", "stacked_below", "start_extents"]


@dataclasses.dataclass(frozen=True)
class Extent:
    """What a box fills, or may fill in part: its middle and half its edges seen from above, and its heights."""

    x: float
    y: float
    half_x: float
    half_y: float
    bottom: float
    top: float

    def gap(self, other: Extent) -> float:
        """Return how far two extents are apart seen from above; negative where they overlap."""
        along_x = abs(self.x - other.x) - self.half_x - other.half_x
        along_y = abs(self.y - other.y) - self.half_y - other.half_y
        return math.hypot(max(along_x, 0.0), max(along_y, 0.0)) or max(along_x, along_y)


def box_at(centre: Vec3, size: float) -> Extent:
    """Return what a box fills whose centre is there."""
    half = size / 2
    return Extent(centre[0], centre[1], half, half, centre[2] - half, centre[2] + half)


def kit_tables(task: Task) -> list[Table]:
    """Return the tables on which the kit may be."""
    return [table for table in task.tables if task.layout.kit in ("random", table.name)]


def kit_extent(task: Task, table: Table) -> Extent:
    """Return what the kit fills on a table."""
    half = task.kit.size[0] / 2
    top = table.top + task.kit.thickness + task.kit.wall_height
    return Extent(table.position[0], table.position[1], half, half, table.top, top)


def stacked_below(task: Task, name: str) -> float:
    """Return the height of what is below a box in the stack of the layouts."""
    stack = task.layout.stack
    return sum(map(task.edge, stack[: stack.index(name)]), 0.0) if name in stack else 0.0


def start_extents(task: Task, name: str, kit_table: Table) -> list[Extent]:
    """Return where a box may start while the kit is on a table: at its fixed place, or around each other table's middle."""
    size = task.edge(name)
    for fixed in task.layout.fixed:
        if fixed.object == name:
            return [box_at(_plus(task.robot_position, fixed.position), size)]
    below = stacked_below(task, name)
    return [
        Extent(
            table.position[0],
            table.position[1],
            table.size[0] / 2 - task.layout.margin + size / 2,
            table.size[1] / 2 - task.layout.margin + size / 2,
            table.top + below,
            table.top + below + size,
        )
        for table in task.tables
        if table is not kit_table
    ]


def place_extents(task: Task, place: Target, kit_table: Table) -> list[Extent]:
    """Return what a box may fill once it is at a place, while the kit is on a table."""
    size = task.edge(place.object)
    root, offset = resolve(task, place)
    if root not in task.object_names:
        origin = kit_origin(task, kit_table) if root == task.kit.name else task.robot_position
        return [box_at(_plus(origin, offset), size)]
    found, wider, half = [], (size - task.edge(root)) / 2, task.edge(root) / 2
    for start in start_extents(task, root, kit_table):
        bottom = start.bottom + half + offset[2] - size / 2
        x, y = start.x + offset[0], start.y + offset[1]
        found.append(Extent(x, y, start.half_x + wider, start.half_y + wider, bottom, bottom + size))
    return found


def _plus(a: Vec3, b: Vec3) -> Vec3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]
