"""Places of trays and slots, as a person sees and drags them."""

from __future__ import annotations

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import kit_table
from bt_jax.app.state.extents import Point
from bt_jax.app.state.kit.trays import change_tray, tray_of
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task
from bt_jax.tasks.things import Vec2

__all__ = ["from_seen", "moved_tray", "point_in_tray", "seen"]

STEP = 0.005  # metres, to which a slot is rounded that was clicked


def seen(task: Task, along: Vec2, *, signed: bool) -> Vec2:
    """Return lengths along the world's x and y as those to the right and away from a person who faces the robot."""
    right, away = (a * along[0] + b * along[1] for a, b, _ in (task.right, task.away))
    return (right, away) if signed else (abs(right), abs(away))


def from_seen(task: Task, lengths: Vec2, *, signed: bool) -> Vec2:
    """Return lengths to the right and away as those along the world's x and y."""
    x, y = (round(lengths[0] * task.right[k] + lengths[1] * task.away[k], 4) + 0.0 for k in (0, 1))
    return (x, y) if signed else (abs(x), abs(y))


def moved_tray(task: Task, start: World, name: str, position: Point) -> Task:
    """Return the task with a tray where it was dropped: on another table, it is there in every start. Raise UserError if it
    was dropped beside the tables."""
    for table in task.tables:
        away = np.subtract(position[:2], table.position[:2])
        if np.all(np.abs(away) <= np.array(table.size[:2]) / 2):
            kit = tray_of(task, name)
            now = kit.table or kit_table(task, start)
            x, y = (round(float(value), 4) + 0.0 for value in away)
            return change_tray(task, name, position=(x, y), table=kit.table if table.name == now else table.name)
    raise UserError(f"there is no table there; drop {name} on one")


def point_in_tray(task: Task, start: World, name: str, point: Point) -> Vec2:
    """Return a point of the world in a tray's frame, rounded to what people mean."""
    local = np.subtract(point, np.asarray(start.kits[0, task.kit_names.index(name)], float))
    x, y = (STEP * round(float(value) / STEP) for value in local[:2])
    return x, y
