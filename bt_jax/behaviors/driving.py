"""What is within reach of a robot that drives, and where it drives to reach something: the reference, like `geometry`.

A robot drives to the nearest station, in metres of its way, from which it reaches what it approaches: the first of equals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from bt_jax.behaviors.geometry import BASE, Poses, in_own_target, is_loose, is_off_floor, is_within_reach
from bt_jax.tasks.roadmap import roadmap
from bt_jax.tasks.stations import in_reach
from bt_jax.tasks.task import Task
from bt_jax.tasks.things import Vec2, Vec3

__all__ = ["approached", "is_near"]


def is_near(task: Task, poses: Poses, name: str, position: Vec3 | None = None, *, held: str | None = None) -> bool:
    """Is what `reachable(name, position)` means within reach: an object, any instance of a part that may be taken, or the
    place at a position in a frame?"""
    return any(is_within_reach(task, poses, point) for point in _meant(task, poses, name, position, held))


def approached(
    task: Task, poses: Poses, name: str, position: Vec3 | None = None, *, held: str | None = None
) -> Vec2 | None:
    """Return where the base is after one step towards what `approach(name, position)` means, x and y in the frame of the
    poses, which is the world's; None if it is reached from no station."""
    ways, here = roadmap(task), poses[BASE].position[:2]
    at = min(range(len(ways.waypoints)), key=lambda i: math.dist(ways.waypoints[i], here))
    points = list(_meant(task, poses, name, position, held))
    far = [
        (ways.distances[at][i], i)
        for i, station in enumerate(ways.stations)
        if any(in_reach(task, station, point) for point in points)
    ]
    return ways.waypoints[ways.following[at][min(far)[1]]] if far else None


def _meant(task: Task, poses: Poses, name: str, position: Vec3 | None, held: str | None) -> Iterator[Vec3]:
    """Yield the points that a name, or a position in a frame, stands for."""
    if name not in poses and name in task.frames:
        return  # nobody knows where it is
    if position is not None or name in task.kit_names:
        x, y, z = poses[name].apply(position or (0.0, 0.0, 0.0)).tolist()
        yield x, y, z
    elif name in task.object_names:
        if is_off_floor(task, poses, name):
            yield poses[name].position
    else:
        done = in_own_target(task, poses, held=held)
        for one in task.instances[name]:
            if one in poses and one not in done and one != held and is_loose(task, poses, one, held=held):
                yield poses[one].position
