"""Which objects a command may set in motion: those near the one that was taken or let go."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.mjx_env.skills import LIFT, Released
from bt_jax.mjx_env.world import Array, namespace, uprightness
from bt_jax.tasks import Object, Task

__all__ = ["REACH", "neighbours"]

REACH = 0.87  # half the diagonal of a cube, in its edges, rounded up
NEAR = 3.5  # radius of a cube's neighbourhood, in its edges
TRAVEL = NEAR - 2 * REACH  # how far what is released may go before the neighbourhood is too small, in its heights


def neighbours(task: Task, released: Released) -> Bool[Array, "S B"]:
    """Return the objects that may move: near the one that was let go, or, if one was taken, in touch with it. NumPy or
    JAX."""
    xp, sizes = namespace(released.poses), _sizes(task)
    count = len(task.objects)
    rows = np.arange(released.box.shape[0])
    box = xp.maximum(released.box, 0)
    own = np.arange(count, dtype=np.int32)[None] == box[:, None]
    taken = released.world.held.astype(np.int32) == released.box
    raised = xp.asarray(sizes.edges)[box] * np.float32(LIFT)
    here = released.poses[rows, box, :3]
    here = xp.concatenate([here[:, :2], (here[:, 2] - xp.where(taken, raised, np.float32(0)))[:, None]], axis=1)
    offset = released.poses[..., :3] - here[:, None]
    flat = xp.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
    near = released.present & (flat < xp.asarray(sizes.near)[box]) & (released.box >= 0)[:, None]
    halves = xp.asarray(sizes.halves)
    reach = (halves[box][:, None] + halves[None]) * np.float32(1.05)
    touches = (xp.abs(offset) < reach).all(axis=-1) & ~(own & (released.box >= 0)[:, None])
    tilted = xp.abs(released.poses[..., 3]) < np.float32(0.999)
    if not task.all_cubes:
        leans = xp.abs(uprightness(released.poses[..., 3:])) < np.float32(0.996)
        tilted = xp.where(sizes.are_cubes[None], tilted, leans)
    loose = (touches | (near & tilted)).any(axis=1)
    return near & (~taken | loose)[:, None]


class _Sizes(NamedTuple):
    """Of the objects of a task, metres."""

    edges: Float32[np.ndarray, " B"]  # the longest ones
    near: Float32[np.ndarray, "B B"]  # see `_near`
    halves: Float32[np.ndarray, "B 3"]  # see `_level_halves`
    are_cubes: Bool[np.ndarray, " B"]


@functools.lru_cache(maxsize=16)
def _sizes(task: Task) -> _Sizes:
    objects = task.objects
    return _Sizes(
        np.array([thing.edge for thing in objects], np.float32),
        np.array([[_near(thing, other) for other in objects] for thing in objects], np.float32),
        np.array([_level_halves(thing) for thing in objects], np.float32),
        np.array([thing.is_cube for thing in objects]),
    )


def _near(thing: Object, other: Object) -> float:
    """Return how far, seen from above, another object may be from a released one to belong to its neighbourhood."""
    if thing.is_cube and other.is_cube:
        return NEAR * max(thing.edge, other.edge)
    return thing.radius + other.radius + TRAVEL * max(thing.height, other.height)


def _level_halves(thing: Object) -> tuple[float, float, float]:
    """Return half the extents of an upright object in the widest turn; of a cube, half its edges."""
    x, y, z = (edge / 2 for edge in thing.size)
    across = x if thing.is_cube or thing.shape == "cylinder" else math.hypot(x, y)
    return across, across, z
