"""Where objects may be in the layouts of a task, before any layout is seen: upright blocks in the world [m]."""

from __future__ import annotations

import dataclasses
import math

from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import about_vertical, added, kit_origin, resolve, start_turn
from bt_jax.tasks.things import Vec3

__all__ = [
    "Extent",
    "block_at",
    "half_of",
    "kit_extents",
    "kit_tables",
    "place_extents",
    "stacked_below",
    "start_extents",
    "turn_at",
]


@dataclasses.dataclass(frozen=True)
class Extent:
    """What an object fills, or may fill in part: its middle and half its edges seen from above, and its heights."""

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


def block_at(centre: Vec3, half: Vec3) -> Extent:
    """Return what a block with these half extents fills whose centre is there."""
    return Extent(centre[0], centre[1], half[0], half[1], centre[2] - half[2], centre[2] + half[2])


def turn_at(task: Task, place: Target) -> float | None:
    """Return how an object at a place is turned in the world, degrees; None if that is not the same in all layouts. What no
    place turns stays as it was at the start."""
    if place.turn is None:
        return start_turn(task, place.object)
    if place.frame not in task.object_names:
        return place.turn
    below = next((target for target in task.targets if target.object == place.frame), None)
    frame = start_turn(task, place.frame) if below is None else turn_at(task, below)
    return None if frame is None else frame + place.turn


def half_of(task: Task, name: str, turn: float | None) -> Vec3:
    """Return half the extents of an object that is turned in the world by so many degrees; by any, if that is None."""
    thing = task.thing(name)
    x, y, z = thing.half_at(turn)
    if turn is None and thing.shape == "cuboid":
        return math.hypot(x, y), math.hypot(x, y), z
    return x, y, z


def kit_tables(task: Task) -> list[Table]:
    """Return the tables on which the kits may be that do not name their own."""
    return [table for table in task.tables if task.layout.kit in ("random", table.name)]


def kit_extents(task: Task, table: Table) -> dict[str, Extent]:
    """Return what each kit fills while those that do not name their own table are on this one."""
    found = {}
    for kit in task.kits:
        x, y, z = kit_origin(task, table, kit.name)
        found[kit.name] = Extent(x, y, *kit.half, z - kit.plate, z + kit.rim)
    return found


def stacked_below(task: Task, name: str) -> float:
    """Return the height of what is below an object in the stack of the layouts."""
    stack = task.layout.stack
    return sum((task.thing(one).height for one in stack[: stack.index(name)]), 0.0) if name in stack else 0.0


def start_extents(task: Task, name: str, kit_table: Table) -> list[Extent]:
    """Return where an object may start while the kits are on a table: at its fixed place, or around the middle of every
    table without a kit."""
    x, y, z = half_of(task, name, start_turn(task, name))
    for fixed in task.layout.fixed:
        if fixed.object == name:
            return [block_at(added(task.robot_position, fixed.position), (x, y, z))]
    below, taken = stacked_below(task, name), {kit.table or kit_table.name for kit in task.kits}
    return [
        Extent(
            table.position[0],
            table.position[1],
            table.size[0] / 2 - task.layout.margin + x,
            table.size[1] / 2 - task.layout.margin + y,
            table.top + below,
            table.top + below + 2 * z,
        )
        for table in task.tables
        if table.name not in taken
    ]


def place_extents(task: Task, place: Target, kit_table: Table) -> list[Extent]:
    """Return what an object may fill once it is at a place, while the kits are on a table."""
    half = half_of(task, place.object, turn_at(task, place))
    root, offset = resolve(task, place)
    if root not in task.object_names:
        origin = kit_origin(task, kit_table, root) if root in task.kit_names else task.robot_position
        return [block_at(added(origin, offset), half)]
    turn = start_turn(task, root)
    own = half_of(task, root, turn)
    around = math.hypot(offset[0], offset[1]) if turn is None else 0.0
    x, y, z = (0.0, 0.0, offset[2]) if turn is None else about_vertical(offset, turn)
    found = []
    for start in start_extents(task, root, kit_table):
        wider = [a - b + around for a, b in zip(half, own, strict=True)]
        bottom = start.bottom + own[2] + z - half[2]
        found.append(
            Extent(start.x + x, start.y + y, start.half_x + wider[0], start.half_y + wider[1], bottom,
                   bottom + 2 * half[2])
        )  # fmt: skip
    return found
