"""Whether an episode of a task can start: what the layout names is there, and there is room for the objects."""

from __future__ import annotations

import math
from collections.abc import Iterator

from bt_jax.tasks.footprints import Footprint, overlap
from bt_jax.tasks.refusals import Fail
from bt_jax.tasks.support import kit_origin
from bt_jax.tasks.task import Target, Task
from bt_jax.tasks.things import Kit, Object, Table, Vec3

__all__ = ["LAYOUT_RULES", "block_overlap", "check_layout_names"]

DENSEST = (
    0.6  # share of the tables that circles around the objects may cover; about 0.5 is reached by drawing at random
)


def check_layout_names(task: Task, fail: Fail) -> None:
    """Fail for a layout that names what the task does not have, or names something twice."""
    tables = [table.name for table in task.tables]
    if task.layout.kit != "random" and task.layout.kit not in tables:
        fail("layout.kit", f"there is no table '{task.layout.kit}'", f"use random or one of {', '.join(tables)}")
    for name in task.layout.stack:
        if name not in task.object_names:
            fail("layout.stack", f"there is no object '{name}'", f"use some of {', '.join(task.object_names)}")
    if len(set(task.layout.stack)) < len(task.layout.stack):
        fail("layout.stack", "an object is listed twice", "name each object once")
    _check_fixed_names(task, fail)


def _free_tables(task: Task) -> Iterator[list[Table]]:
    """Yield the tables without a kit, for each table on which the kits may be that do not name theirs."""
    named = {kit.table for kit in task.kits if kit.table}
    anywhere = any(not kit.table for kit in task.kits)
    for table in task.tables:
        if not anywhere or task.layout.kit in ("random", table.name):
            taken = {*named, table.name} if anywhere else named
            yield [other for other in task.tables if other.name not in taken]


def _check_room(task: Task, fail: Fail) -> None:
    layout, free = task.layout, list(_free_tables(task))
    if not all(free):
        fail("tables", "the kits may take every table, and the objects need another", "add a table, or name the kits'")
    rooms = [[[edge - 2 * layout.margin for edge in table.size[:2]] for table in tables] for tables in free]
    if min(edge for tables in rooms for room in tables for edge in room) < 0:
        fail("layout.margin", f"{layout.margin} m from every edge leaves no room on a table", "lower it")
    placed = [place.object for place in layout.fixed]
    loose = [thing for thing in task.objects if thing.name not in placed]
    if task.draws_by_size:
        _check_circles(task, loose, free, fail)
        return
    if not layout.spacing:
        return
    # Half of what a square lattice would hold: then random placement finds room without trying long.
    lattices = [[math.prod(1 + int(edge / layout.spacing) for edge in room) for room in tables] for tables in rooms]
    if min(sum(max(1, lattice // 2) for lattice in tables) for tables in lattices) < len(loose):
        problem = f"{len(loose)} objects do not fit {layout.spacing} m apart on the tables"
        fail("layout.spacing", problem, "lower spacing or margin, or add tables")


def _check_circles(task: Task, loose: list[Object], free: list[list[Table]], fail: Fail) -> None:
    """Fail if an object is larger than a table, or circles that keep all apart cover more than the tables can hold."""
    layout = task.layout
    first = [task.widest_with(thing.name) for thing in loose if thing.name not in layout.stack[1:]]
    for thing in first:
        narrow = [t.name for tables in free for t in tables if 2 * thing.reach > min(t.size[:2])]
        if narrow:
            i = task.object_names.index(thing.name)
            problem = f"{thing.name} ({thing.measures}) does not fit on {narrow[0]} in every turn"
            fail(f"objects[{i}].size", problem, "make it smaller or the table larger")
    radii = [max(layout.spacing / 2, thing.reach + task.finger_room) for thing in first]
    covered = sum(math.pi * radius**2 for radius in radii)
    beyond = sum(radii) / max(1, len(radii))  # the circles may reach beyond the area in which their middles are
    spans = [[[edge - 2 * layout.margin + 2 * beyond for edge in t.size[:2]] for t in tables] for tables in free]
    if covered > DENSEST * min(sum(map(math.prod, tables)) for tables in spans):
        problem = (
            f"{len(first)} objects, {layout.spacing} m apart and with room for the fingers, do not fit on the tables"
        )
        fail("objects", problem, "use fewer or smaller objects, lower layout.spacing or layout.margin, or add tables")


def _check_fixed_names(task: Task, fail: Fail) -> None:
    fixed = task.layout.fixed
    if fixed and task.layout.kit == "random" and any(not kit.table for kit in task.kits):
        fail("layout.kit", "the kit may be placed where an object is fixed", "name the kit's table")
    for i, place in enumerate(fixed):
        key = f"layout.fixed[{i}]"
        if place.object not in task.object_names:
            fail(f"{key}.object", f"there is no object '{place.object}'", f"use one of {', '.join(task.object_names)}")
        if place.object in task.layout.stack or place.object in [other.object for other in fixed[:i]]:
            fail(f"{key}.object", f"{place.object} has a place already", "give each object one place")
        if place.frame != task.robot_frame:
            fail(f"{key}.frame", f"'{place.frame}' is not the robot's frame", f"use {task.robot_frame}")
        if place.turn is not None and not task.thing(place.object).symmetry:
            fail(f"{key}.turn", f"{place.object} is a cylinder, which looks alike in every turn", "leave turn out")


def _check_fixed(task: Task, fail: Fail) -> None:
    fixed = task.layout.fixed
    for i, place in enumerate(fixed):
        key, thing = f"layout.fixed[{i}]", task.thing(place.object)
        half, slack = thing.half_at(place.turn), 0.1 * thing.height
        for kit in task.kits:
            if _is_inside(task, kit, place, slack):
                fail(f"{key}.position", f"{place.object} would be inside {kit.name}", "move it to free space")
        for other in fixed[:i]:
            beyond = task.thing(other.object).half_at(other.turn)
            if block_overlap(half, place.position, beyond, other.position) > slack:
                fail(f"{key}.position", f"{place.object} would be inside {other.object}", "move it to free space")
        x, y, z = (a + b for a, b in zip(place.position, task.robot_position, strict=True))
        under = [
            t
            for t in task.tables
            if abs(x - t.position[0]) <= t.size[0] / 2 and abs(y - t.position[1]) <= t.size[1] / 2
        ]
        if not any(z - half[2] > table.top - slack for table in under):
            fail(f"{key}.position", f"{place.object} would not be over a table", "move it over one")


def _is_inside(task: Task, kit: Kit, place: Target, slack: float) -> bool:
    """Return whether a fixed object is more than `slack` inside the plate or a wall of a kit whose table is known."""
    table = next(table for table in task.tables if table.name in (kit.table, task.layout.kit))
    apart = [
        at + base - origin
        for at, base, origin in zip(place.position, task.robot_position, kit_origin(task, table, kit.name), strict=True)
    ]
    thing = task.thing(place.object)
    covered, bottom = Footprint.of(thing, (apart[0], apart[1]), place.turn or 0.0), apart[2] - thing.height / 2
    blocks = [((0.0, 0.0), kit.half, kit.plate), *((middle, half, kit.rim) for middle, half in kit.walls())]
    return any(
        top - bottom > slack and overlap(covered, Footprint(middle, half)) > slack for middle, half, top in blocks
    )


def block_overlap(half: Vec3, position: Vec3, other_half: Vec3, other_position: Vec3) -> float:
    """Return by how much two blocks overlap, along the axis on which that is the least; negative if they do not."""
    halves = zip(half, other_half, position, other_position, strict=True)
    return min(a + b - abs(x - y) for a, b, x, y in halves)


LAYOUT_RULES = (_check_fixed, _check_room)
