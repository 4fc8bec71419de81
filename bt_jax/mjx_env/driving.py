"""Where a base drives, and what is within reach of it, for whole batches of states; NumPy or JAX. `behaviors.driving` says
the same for single states.
"""

from __future__ import annotations

import dataclasses
import functools

import numpy as np
from jaxtyping import Bool, Float32, Int32

from bt_jax.mjx_env.world import Array, World, distances, namespace
from bt_jax.tasks import Task
from bt_jax.tasks.roadmap import roadmap

__all__ = ["drive", "driven", "start", "stations_near", "within_reach"]


@dataclasses.dataclass(frozen=True)
class _Ways:
    """The ways of a base as arrays (NumPy): see `tasks.roadmap`."""

    waypoints: Float32[np.ndarray, "W 2"]
    stations: Float32[np.ndarray, "n 3"]  # where the arm is above each
    distances: Float32[np.ndarray, "W n"]
    following: Int32[np.ndarray, "W n"]


@functools.lru_cache(maxsize=16)
def _ways(task: Task) -> _Ways:
    found = roadmap(task)
    return _Ways(
        np.array(found.waypoints, np.float32),
        np.array([(*station, task.robot_position[2]) for station in found.stations], np.float32),
        np.array(found.distances, np.float32),
        np.array(found.following, np.int32),
    )


def start(task: Task, count: int) -> Float32[np.ndarray, "count 2"] | None:
    """Return where the base is at the start of `count` episodes (NumPy); None where the robot does not drive."""
    return None if task.robot.base is None else np.tile(_ways(task).waypoints[:1], (count, 1))


def within_reach(world: World, task: Task, points: Float32[Array, "S n 3"]) -> Bool[Array, "S n"]:
    """Return which points of the world the arm reaches from where the base is; all where the robot does not drive."""
    xp = namespace(points)
    if task.robot.base is None or world.base is None:
        return xp.ones(points.shape[:-1], bool)
    height = xp.full((*world.base.shape[:-1], 1), task.robot_position[2], np.float32)
    arm = xp.concatenate([world.base, height], axis=-1)
    return distances(arm[:, None], points) <= np.float32(task.robot.base.reach)


def stations_near(task: Task, points: Float32[Array, "S n 3"]) -> Bool[Array, "S n stations"]:
    """Return from which stations the arm reaches each point of the world."""
    assert task.robot.base is not None
    return distances(points[:, :, None], _ways(task).stations[None, None]) <= np.float32(task.robot.base.reach)


def driven(before: Float32[Array, "*S 2"] | None, after: Float32[Array, "*S 2"] | None) -> Float32[Array, "*S"] | None:
    """Return how far bases are from where they were, metres; None where the robot does not drive."""
    if before is None or after is None:
        return None
    return namespace(after).sqrt(((after - before) ** 2).sum(axis=-1))


def drive(task: Task, base: Float32[Array, "S 2"], near: Bool[Array, "S stations"]) -> Float32[Array, "S 2"]:
    """Return where a base is after one step to the nearest of some stations, the first of equals. It stays where there is
    none."""
    xp, ways = namespace(base), _ways(task)
    here = xp.argmin(((base[:, None] - ways.waypoints[None]) ** 2).sum(axis=-1), axis=1)
    far = xp.where(near, xp.asarray(ways.distances)[here], np.float32(np.inf))
    following = xp.asarray(ways.following)[here, xp.argmin(far, axis=1)]
    return xp.where(near.any(axis=1, keepdims=True), xp.asarray(ways.waypoints)[following], base)
