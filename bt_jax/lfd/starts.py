"""How the layouts of a task begin: which boxes stand on each other, and which are where others should be."""

from __future__ import annotations

import math

from bt_jax.lfd.extents import Extent, box_at, kit_tables, place_extents, stacked_below, start_extents
from bt_jax.tasks import Target, Task
from bt_jax.tasks.support import resolve

__all__ = ["TOUCH", "above", "fills", "may_fill", "may_start_at", "start_height"]

TOUCH = 1e-3  # overlaps up to this are contacts, metres


def above(task: Task, name: str) -> frozenset[str]:
    """Return the boxes that start on a box, and on those."""
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
    """Return whether a box fills a place in every layout, as long as nothing has been moved."""
    root, offset = resolve(task, place)
    stack, fixed = task.layout.stack, [one.object for one in task.layout.fixed]
    if name in stack and root in stack:
        rise = start_height(task, name) - start_height(task, root) + (task.edge(name) - task.edge(root)) / 2
        thing = box_at((0.0, 0.0, rise), task.edge(name))
        return name != root and _in_the_way(thing, box_at(offset, task.edge(place.object)))
    exact = name in fixed and (root in fixed or root not in task.object_names)
    return exact and name != root and _may_overlap(task, name, place)


def may_fill(task: Task, name: str, place: Target) -> bool:
    """Return whether a box fills a place in some layouts, as long as nothing has been moved."""
    root, (x, y, z) = resolve(task, place)
    stack, fixed = task.layout.stack, [one.object for one in task.layout.fixed]
    if name == root or (name in stack and root in stack):
        return fills(task, name, place)
    if root not in task.object_names or root in fixed or name in fixed:
        return _may_overlap(task, name, place)
    # Both are somewhere on the tables, apart by the layout's spacing.
    size = task.edge(place.object)
    reach = (size + task.edge(name)) / 2 - TOUCH
    near = math.hypot(abs(x) + reach, abs(y) + reach) > task.layout.spacing
    bottom = start_height(task, root) + task.edge(root) / 2 + z - size / 2
    return near and start_height(task, name) + task.edge(name) > bottom + TOUCH


def may_start_at(task: Task, place: Target) -> bool:
    """Return whether the box of a place may be there from the start."""
    return any(
        start.gap(goal) < 0
        for table in kit_tables(task)
        for start in start_extents(task, place.object, table)
        for goal in place_extents(task, place, table)
    )


def _may_overlap(task: Task, name: str, place: Target) -> bool:
    return any(
        _in_the_way(start, goal)
        for table in kit_tables(task)
        for start in start_extents(task, name, table)
        for goal in place_extents(task, place, table)
    )


def start_height(task: Task, name: str) -> float:
    """Return the height of a box's lower face in its stack, or in the world at its fixed place [m]."""
    fixed = [one.object for one in task.layout.fixed]
    if name in fixed:
        return start_extents(task, name, kit_tables(task)[0])[0].bottom
    return stacked_below(task, name)


def _in_the_way(thing: Extent, goal: Extent) -> bool:
    """Return whether a box cannot be lowered to its goal because of another."""
    return thing.gap(goal) < -TOUCH and thing.top > goal.bottom + TOUCH
