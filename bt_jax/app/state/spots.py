"""Places as people describe them: from the middle of a table, from the kit, or from another box.

A spot says how far to the right, how far away and how high, as seen by a person who faces the robot. The height is that of
the underside above the reference: 0 is on the table, on the kit's floor, on top of the other box.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from bt_jax.app.state.arrangement import goals
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Table, Task

__all__ = ["Spot", "origins", "spot_at", "spot_of_target"]

Point = Float[np.ndarray, "3"]


@dataclasses.dataclass(frozen=True)
class Spot:
    """A place relative to `reference`: a box, the kit, or a table. Metres."""

    reference: str
    right: float
    away: float
    up: float

    def point(self, task: Task, name: str, where: Mapping[str, Point]) -> Point:
        """Return the centre of the box `name` in the world; `where` are the `origins`."""
        offset = self.right * np.array(task.right) + self.away * np.array(task.away)
        half = task.edge(name) / 2
        return where[self.reference] + offset + np.array([0, 0, self.up + half])

    def frame(self, task: Task) -> str:
        """Return the frame of a target there; that of the robot for a table, since tables do not move."""
        return self.reference if self.reference in task.frames else task.robot_frame


def origins(task: Task, world: World, *, ended: bool) -> dict[str, Point]:
    """Return the world positions of the references: the middles of the tables' tops, of the kit's floor, and of the boxes'
    tops, as they are in `world` (a batch of one), or with `ended` once all targets are met."""
    found = {table.name: np.array([*table.position[:2], table.top]) for table in task.tables}
    found[task.kit.name] = np.add(world.kits[0, 0], (0.0, 0.0, task.kit.thickness / 2))
    centres = {name: np.asarray(world.poses[0, i, :3], float) for i, name in enumerate(task.object_names)}
    if ended:
        centres |= goals(task, world)
    for box in task.objects:
        found[box.name] = np.add(centres[box.name], (0.0, 0.0, box.edge / 2))
    return found


def spot_at(task: Task, world: World, name: str) -> Spot:
    """Return where a box is now, from the middle of the nearest table."""
    centre = np.asarray(world.poses[0, task.object_names.index(name), :3], float)
    return _relative(task, name, centre, _table(task, centre).name, origins(task, world, ended=False))


def spot_of_target(task: Task, world: World, name: str) -> Spot:
    """Return where the target of a box is, from the frame in which it is given, or from the table there."""
    target = next(target for target in task.targets if target.object == name)
    goal = goals(task, world)[name]
    reference = _table(task, goal).name if target.frame == task.robot_frame else target.frame
    return _relative(task, name, goal, reference, origins(task, world, ended=True))


def _relative(task: Task, name: str, centre: Point, reference: str, where: Mapping[str, Point]) -> Spot:
    offset = centre - where[reference]
    half = task.edge(name) / 2
    right, away = float(offset @ np.array(task.right)), float(offset @ np.array(task.away))
    return Spot(reference, right, away, float(offset[2]) - half)


def _table(task: Task, point: Point) -> Table:
    return min(task.tables, key=lambda table: float(np.linalg.norm(np.subtract(table.position[:2], point[:2]))))
