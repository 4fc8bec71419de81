"""How the layouts of a task begin: which objects stand on each other, and which are where others should be."""

from __future__ import annotations

import math

from bt_jax.lfd.extents import (
    Extent,
    block_at,
    half_of,
    kit_tables,
    place_extents,
    stacked_below,
    start_extents,
    turn_at,
)
from bt_jax.lfd.fingers import grasps, hit, walls
from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import kit_origin, resolve, start_turn

__all__ = [
    "TOUCH",
    "above",
    "beside",
    "fills",
    "may_fill",
    "may_start_at",
    "shuts_in",
    "start_height",
    "starts_at",
]

TOUCH = 1e-3  # overlaps up to this are contacts, metres


def above(task: Task, name: str) -> frozenset[str]:
    """Return the objects that start on an object, and on those."""
    stack, table = task.layout.stack, kit_tables(task)[0]
    if name in stack:
        return frozenset(stack[stack.index(name) + 1 :])
    fixed = {one.object: start_extents(task, one.object, table)[0] for one in task.layout.fixed}
    over = [
        other
        for other, extent in fixed.items()
        if name in fixed and extent.bottom > fixed[name].bottom + TOUCH and extent.gap(fixed[name]) < -TOUCH
    ]
    return frozenset().union(over, *(above(task, other) for other in over))


def fills(task: Task, name: str, place: Target) -> bool:
    """Return whether an object fills a place in every layout, as long as nothing has been moved."""
    root, offset = resolve(task, place)
    stack, fixed = task.layout.stack, [one.object for one in task.layout.fixed]
    if name in stack and root in stack:
        own, half, below = (task.thing(one).half_at(0.0) for one in (name, place.object, root))
        if place.turn is not None:
            half = task.thing(place.object).half_at(place.turn)
        rise = start_height(task, name) + own[2] - start_height(task, root) - below[2]
        return name != root and _in_the_way(block_at((0.0, 0.0, rise), own), block_at(offset, half))
    return name in fixed and name != root and _is_exact(task, place) and _may_overlap(task, name, place)


def may_fill(task: Task, name: str, place: Target) -> bool:
    """Return whether an object fills a place in some layouts, as long as nothing has been moved."""
    root, (x, y, z) = resolve(task, place)
    stack, fixed = task.layout.stack, [one.object for one in task.layout.fixed]
    if name == root or (name in stack and root in stack):
        return fills(task, name, place)
    if root not in task.object_names or root in fixed or name in fixed:
        return _may_overlap(task, name, place)
    # Both are somewhere on the tables, apart by the layout's spacing.
    half, own = half_of(task, place.object, turn_at(task, place)), half_of(task, name, start_turn(task, name))
    reach_x, reach_y = (a + b - TOUCH for a, b in zip(half[:2], own[:2], strict=True))
    near = math.hypot(abs(x) + reach_x, abs(y) + reach_y) > task.layout.spacing
    if start_turn(task, root) is None:
        near = math.hypot(x, y) + math.hypot(reach_x, reach_y) > task.layout.spacing
    bottom = start_height(task, root) + task.thing(root).height / 2 + z - half[2]
    return near and start_height(task, name) + 2 * own[2] > bottom + TOUCH


def may_start_at(task: Task, place: Target) -> bool:
    """Return whether the object of a place may be there from the start."""
    return any(
        start.gap(goal) < 0
        for table in kit_tables(task)
        for name in task.instances[place.object]
        for start in start_extents(task, name, table)
        for goal in place_extents(task, place, table)
    )


def starts_at(task: Task, name: str, target: Target) -> bool:
    """Return whether an object is at a target from the start, in every layout."""
    if not _is_exact(task, target) or name not in [one.object for one in task.layout.fixed]:
        return False
    table, here = kit_tables(task)[0], start_turn(task, name)
    start, goal = start_extents(task, name, table)[0], place_extents(task, target, table)[0]
    off = math.dist((start.x, start.y, start.bottom), (goal.x, goal.y, goal.bottom))
    period, wanted = task.thing(name).symmetry, turn_at(task, target)
    if target.turn is None or not period or here is None or wanted is None:
        return off < task.episode.tolerance
    error = abs((here - wanted + period / 2) % period - period / 2)
    return off < task.episode.tolerance and error < task.episode.turn_tolerance


def beside(task: Task, name: str) -> frozenset[str]:
    """Return the objects that leave the fingers no room beside an object in every layout, and what stands on them: those on
    the side where there are fewest."""
    fixed, table = [one.object for one in task.layout.fixed], kit_tables(task)[0]
    if name not in fixed:
        return frozenset()
    starts = {other: start_extents(task, other, table)[0] for other in fixed if other != name}
    ways = [[other for other in starts if hit(fingers, starts[other])] for fingers in _grasps(task, name, table)]
    found = min(ways, key=len, default=[])
    return frozenset().union(found, *(above(task, other) for other in found)) - {name}


def shuts_in(task: Task, place: Target, name: str) -> bool:
    """Return whether the object of a place leaves the fingers less room beside another one where that starts."""
    if name not in [one.object for one in task.layout.fixed] or not _is_exact(task, place):
        return False
    table = kit_tables(task)[0]
    goal = place_extents(task, place, table)[0]
    return any(hit(fingers, goal) for fingers in _grasps(task, name, table))


def _grasps(task: Task, name: str, table: Table) -> list[tuple[Extent, ...]]:
    """Return what the fingers fill for each way to take an object from its fixed place that no wall of a kit prevents."""
    start = start_extents(task, name, table)[0]
    centre = start.x, start.y, (start.bottom + start.top) / 2
    around = [wall for kit in task.kits for wall in walls(kit, kit_origin(task, table, kit.name))]
    ways = grasps(task, name, centre, start_turn(task, name))
    return [fingers for fingers in ways if not any(hit(fingers, wall) for wall in around)]


def _is_exact(task: Task, place: Target) -> bool:
    """Return whether a place is the same in the world in every layout with fixed objects."""
    root = resolve(task, place)[0]
    return root not in task.object_names or root in [one.object for one in task.layout.fixed]


def _may_overlap(task: Task, name: str, place: Target) -> bool:
    return any(
        _in_the_way(start, goal)
        for table in kit_tables(task)
        for start in start_extents(task, name, table)
        for goal in place_extents(task, place, table)
    )


def start_height(task: Task, name: str) -> float:
    """Return the height of an object's lower face in its stack, or in the world at its fixed place [m]."""
    fixed = [one.object for one in task.layout.fixed]
    if name in fixed:
        return start_extents(task, name, kit_tables(task)[0])[0].bottom
    return stacked_below(task, name)


def _in_the_way(thing: Extent, goal: Extent) -> bool:
    """Return whether an object cannot be lowered to its goal because of another."""
    return thing.gap(goal) < -TOUCH and thing.top > goal.bottom + TOUCH
