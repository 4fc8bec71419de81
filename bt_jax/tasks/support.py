"""Whether anything can be under a target: a box whose target is in the air falls, and no tree can keep it there."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator

from bt_jax.tasks.task import Table, Target, Task, Vec3

__all__ = ["kit_origin", "resolve", "unsupported"]

COMBINED = 8  # loose boxes whose stacks are considered; with more, nearly every height is possible


@dataclasses.dataclass(frozen=True)
class _Top:
    """A level square or rectangle to stand on: its middle, half its edges and its height [m]."""

    x: float
    y: float
    half_x: float
    half_y: float
    z: float

    def is_under(self, x: float, y: float, half: float) -> bool:
        return abs(x - self.x) < self.half_x + half and abs(y - self.y) < self.half_y + half


def unsupported(task: Task) -> Iterator[tuple[int, float]]:
    """Yield the number of each target with nothing under it, and the nearest z [m], in its frame, with something under it.

    What is not known before an episode counts as possible: the table of a kit that is placed at random, and boxes without a
    target in the same scene of reference, alone or stacked, in any place.
    """
    places = [resolve(task, target) for target in task.targets]
    for i, target in enumerate(task.targets):
        root, (x, y, z) = places[i]
        half = task.size(target.object) / 2
        placed = {
            other.object: _Top(at[0], at[1], task.size(other.object) / 2, task.size(other.object) / 2, at[2])
            for other, (of, at) in zip(task.targets, places, strict=True)
            if of == root and other is not target
        }
        tops = [*_tops(task, root), *(dataclasses.replace(top, z=top.z + top.half_x) for top in placed.values())]
        loose = [box.size for box in task.boxes if box.name not in (target.object, root, *placed)]
        if len(loose) > COMBINED or (root in task.box_names and z - half <= -task.size(root) / 2):
            continue
        stacks = {sum(some) for count in range(len(loose) + 1) for some in itertools.combinations(loose, count)}
        heights = [top.z + stack + half for top in tops if top.is_under(x, y, half) for stack in stacks]
        nearest = min(heights, key=lambda height: abs(height - z))
        if abs(nearest - z) > task.episode.tolerance:
            yield i, target.position[2] + nearest - z


def resolve(task: Task, target: Target) -> tuple[str, Vec3]:
    """Return where a target is in the frame that its chain of boxes begins with, and that frame: one without a target."""
    targets = {other.object: other for other in task.targets}
    x, y, z = target.position
    while (below := targets.get(target.frame)) is not None:
        target = below
        x, y, z = x + target.position[0], y + target.position[1], z + target.position[2]
    return target.frame, (x, y, z)


def _tops(task: Task, frame: str) -> Iterator[_Top]:
    """Yield everything but boxes with a target to stand on, in a frame, for every table that the kit may be on."""
    if frame in task.box_names:
        half = task.size(frame) / 2
        yield from (_Top(0.0, 0.0, half, half, half), _Top(0.0, 0.0, math.inf, math.inf, -half))
        return
    for table in task.tables:
        if task.layout.kit in ("random", table.name):
            x, y, z = task.robot_position if frame == task.robot_frame else kit_origin(task, table)
            for top in _world_tops(task, table):
                yield dataclasses.replace(top, x=top.x - x, y=top.y - y, z=top.z - z)


def _world_tops(task: Task, kit_table: Table) -> Iterator[_Top]:
    yield _Top(0.0, 0.0, math.inf, math.inf, task.floor)
    for table in task.tables:
        yield _Top(table.position[0], table.position[1], table.size[0] / 2, table.size[1] / 2, table.top)
    x, y, z = kit_origin(task, kit_table)
    half = task.kit.size / 2
    yield _Top(x, y, half, half, z + task.kit.thickness / 2)
    yield _Top(x, y, half, half, z + task.kit.thickness / 2 + task.kit.wall_height)


def kit_origin(task: Task, table: Table) -> Vec3:
    return table.position[0], table.position[1], table.top + task.kit.thickness / 2
