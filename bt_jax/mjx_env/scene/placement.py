"""Where kits and objects of a task may start, drawn at random; plain NumPy."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float64

from bt_jax._util.errors import UserError
from bt_jax.tasks import Table, Target, Task

__all__ = ["draw_kit_table", "draw_poses"]

TRIES = 1000
DRAWS = 50  # of one object, before all are drawn again


def draw_kit_table(task: Task, rng: np.random.Generator) -> int:
    """Return the index of the table on which the kits stand that do not name their own."""
    names = [table.name for table in task.tables]
    return int(rng.integers(len(names))) if task.layout.kit == "random" else names.index(task.layout.kit)


def draw_poses(task: Task, rng: np.random.Generator, kit_table: Table) -> Float64[np.ndarray, "B 7"]:
    """Return poses in the world, metres and wxyz: a stack counts as one object at a random place."""
    taken = {kit.table or kit_table.name for kit in task.kits}
    tables = [table for table in task.tables if table.name not in taken]
    names, poses = task.object_names, np.zeros((len(task.objects), 7))
    poses[:, 3] = 1
    stack = [names.index(name) for name in task.layout.stack]
    fixed = [names.index(place.object) for place in task.layout.fixed]
    for i, place in zip(fixed, task.layout.fixed, strict=True):
        poses[i] = _fixed_pose(task, place)
    single = [i for i in range(len(names)) if i not in (*stack, *fixed)]
    groups = [group for group in ([stack] if stack else []) + [[i] for i in single]]
    by_size, reach = task.draws_by_size, [task.widest_with(name).reach for name in names]
    if by_size:
        groups.sort(key=lambda group: -reach[group[0]])  # the largest ones while there is room
    for _ in range(TRIES):
        placed = {i: poses[i, :2].copy() for i in fixed}
        for group in groups:
            for _ in range(DRAWS if by_size else 1):
                table = tables[rng.integers(len(tables))]
                room = np.array(table.size[:2]) / 2 - _margin(task, reach[group[0]])
                spot = np.array(table.position[:2]) + rng.uniform(-room, room)
                turn = rng.uniform(-1, 1) * task.layout.turn if task.layout.turn else 0.0
                if by_size and _is_apart(task, reach, group[0], spot, placed):
                    break
            height = table.top
            for i in group:
                poses[i] = (*spot, height + task.objects[i].height / 2, *_turned(turn))
                height += task.objects[i].height
            placed[group[0]] = spot
        rest = dict(placed)
        if all(_is_apart(task, reach, group[0], rest.pop(group[0]), rest) for group in groups):
            return poses
    raise UserError(
        f"task {task.name}: no room for all objects after {TRIES} tries; lower layout.spacing or layout.margin"
    )


def _margin(task: Task, reach: float) -> float:
    """Return how far the centre of an object that reaches so far stays away from a table's edge, metres."""
    return max(task.layout.margin, reach) if task.draws_by_size else task.layout.margin


def _is_apart(
    task: Task,
    reach: Sequence[float],
    thing: int,
    spot: Float64[np.ndarray, "2"],
    placed: Mapping[int, Float64[np.ndarray, "2"]],
) -> bool:
    """Return whether an object is far enough from others; by size, so that two fingers fit between, whatever the turns."""
    for other, there in placed.items():
        least = task.layout.spacing
        if task.draws_by_size:
            least = max(least, reach[thing] + reach[other] + 2 * task.finger_room)
        if math.dist(spot, there) < least:
            return False
    return True


def _fixed_pose(task: Task, place: Target) -> Float64[np.ndarray, "7"]:
    return np.array([*np.add(place.position, task.robot_position), *_turned(place.turn or 0.0)])


def _turned(turn: float) -> tuple[float, float, float, float]:
    """Return the quaternion (wxyz) of a turn about the vertical, degrees."""
    half = math.radians(turn) / 2
    return math.cos(half), 0.0, 0.0, math.sin(half)
