"""Where kit and boxes of a task may start, drawn at random; plain NumPy."""

from __future__ import annotations

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.tasks import Task

__all__ = ["draw_kit_table", "draw_places"]

TRIES = 1000


def draw_kit_table(task: Task, rng: np.random.Generator) -> int:
    """Return the index of the table on which the kit stands."""
    names = [table.name for table in task.tables]
    return int(rng.integers(len(names))) if task.layout.kit == "random" else names.index(task.layout.kit)


def draw_places(task: Task, rng: np.random.Generator, kit_table: int) -> np.ndarray:
    """Return centres [B, 3] in the world, metres: a stack counts as one box at a random place."""
    tables = [table for i, table in enumerate(task.tables) if i != kit_table]
    names, centres = task.box_names, np.zeros((len(task.boxes), 3))
    stack = [names.index(name) for name in task.layout.stack]
    fixed = [names.index(place.object) for place in task.layout.fixed]
    for i, place in zip(fixed, task.layout.fixed, strict=True):
        centres[i] = np.add(place.position, task.robot_position)
    single = [i for i in range(len(names)) if i not in (*stack, *fixed)]
    groups = [group for group in ([stack] if stack else []) + [[i] for i in single]]
    for _ in range(TRIES):
        spots: list[np.ndarray] = []
        for group in groups:
            table = tables[rng.integers(len(tables))]
            room = np.array(table.size[:2]) / 2 - task.layout.margin
            spot = np.array(table.position[:2]) + rng.uniform(-room, room)
            height = table.top
            for i in group:
                centres[i] = (*spot, height + task.boxes[i].size / 2)
                height += task.boxes[i].size
            spots.append(spot)
        gaps = [np.linalg.norm(a - b) for i, a in enumerate(spots) for b in (*spots[:i], *centres[fixed, :2])]
        if not gaps or min(gaps) >= task.layout.spacing:
            return centres
    raise UserError(
        f"task {task.name}: no room for all boxes after {TRIES} tries; lower layout.spacing or layout.margin"
    )
