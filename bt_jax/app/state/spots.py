"""Places as people describe them: from the middle of a table, from a kit, or from another object.

A spot says how far to the right, how far away and how high, as seen by a person who faces the robot. The height is that of
the underside above the reference: 0 is on the table, on the kit's floor, on top of the other object.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from bt_jax.app.state.extents import Point, half_of, heading, poses_now
from bt_jax.app.state.goals import goals, kind_of
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Table, Task

__all__ = ["Spot", "origins", "references", "spot_at", "spot_of_target"]


@dataclasses.dataclass(frozen=True)
class Spot:
    """A place relative to `reference`: an object, a kit, or a table. Metres; `turn` is how the object lies there, degrees
    about the vertical, None where any turn will do or all look alike."""

    reference: str
    right: float
    away: float
    up: float
    turn: float | None = None

    def point(self, task: Task, name: str, where: Mapping[str, Point]) -> Point:
        """Return the centre of the object `name`, or of one of a part, in the world; `where` are the `origins`."""
        offset = self.right * np.array(task.right) + self.away * np.array(task.away)
        half = task.thing(name).height / 2
        return where[self.reference] + offset + np.array([0, 0, self.up + half])

    def frame(self, task: Task) -> str:
        """Return the frame of a target there; that of the robot for a table, since tables do not move."""
        return self.reference if self.reference in task.frames else task.robot_frame


def references(task: Task, name: str) -> list[str]:
    """Return what the place of an object or of one of a part may be measured from: kits, other objects, tables."""
    others = [
        thing.name for thing in task.objects if thing.name != name and len(task.instances.get(thing.part, ())) < 2
    ]
    return [*task.kit_names, *others, *(table.name for table in task.tables)]


def origins(task: Task, world: World, *, ended: bool) -> dict[str, Point]:
    """Return the world positions of the references: the middles of the tables' tops, of the kits' floors, and of the
    objects' tops, as they are in `world` (a batch of one), or with `ended` once all targets are met."""
    found = {table.name: np.array([*table.position[:2], table.top]) for table in task.tables}
    for kit, origin in zip(task.kits, world.kits[0], strict=True):
        found[kit.name] = np.add(origin, (0.0, 0.0, kit.plate))
    poses = poses_now(task, world)
    if ended:
        poses |= {goal.thing: goal.pose for goal in goals(task, world).values()}
    for thing in task.objects:
        found[thing.name] = np.add(poses[thing.name][:3], (0.0, 0.0, half_of(thing, poses[thing.name])[2]))
    return found


def spot_at(task: Task, world: World, name: str) -> Spot:
    """Return where an object is now, from the middle of the nearest table; it is turned by no more than it looks."""
    pose, period = poses_now(task, world)[name], task.thing(name).symmetry
    turn = round(math.remainder(heading(pose), period), 1) + 0.0 if period else None
    return _relative(task, name, pose[:3], _table(task, pose).name, origins(task, world, ended=False), turn)


def spot_of_target(task: Task, world: World, key: str) -> Spot:
    """Return where a target is, from the frame in which it is given, or from the table there."""
    goal = goals(task, world)[key]
    reference = _table(task, goal.pose).name if goal.target.frame == task.robot_frame else goal.target.frame
    where = origins(task, world, ended=True)
    return _relative(task, kind_of(key), goal.pose[:3], reference, where, goal.target.turn)


def _relative(
    task: Task, name: str, centre: Point, reference: str, where: Mapping[str, Point], turn: float | None
) -> Spot:
    offset = centre - where[reference]
    half = task.thing(name).height / 2
    right, away = float(offset @ np.array(task.right)), float(offset @ np.array(task.away))
    return Spot(reference, right, away, float(offset[2]) - half, turn)


def _table(task: Task, point: np.ndarray) -> Table:
    return min(task.tables, key=lambda table: float(np.linalg.norm(np.subtract(table.position[:2], point[:2]))))
