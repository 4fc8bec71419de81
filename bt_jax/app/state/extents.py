"""How the objects of a scene lie, and what room they take there: blocks around them, parallel to the world's axes."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Float32

from bt_jax.mjx_env.surfaces import half_extents
from bt_jax.mjx_env.world import World, headings, rotate, uprightness
from bt_jax.tasks import Object, Task

__all__ = [
    "Point",
    "Pose",
    "carriers",
    "half_of",
    "heading",
    "in_frame",
    "in_world",
    "inside",
    "poses_now",
    "stands",
    "turned",
]

Point = Float[np.ndarray, "3"]
Pose = Float[np.ndarray, "7"]  # position [m], quaternion wxyz; in the world
TOUCHING = 0.05  # objects that overlap by less than this part of their size only touch
STANDS = 0.996  # cosine of the inclination up to which an object stands as it was made: 5 degrees


def half_of(thing: Object, pose: Pose) -> Point:
    """Return half the extents of an object along the world's axes, metres."""
    return np.asarray(half_extents([thing], _quaternion(pose)[None])[0], float)


def in_world(frame: Pose, point: Point) -> Point:
    """Return a point of a frame in the world."""
    return frame[:3] + np.asarray(rotate(_quaternion(frame), np.asarray(point, np.float32)), float)


def in_frame(frame: Pose, point: Point) -> Point:
    """Return a point of the world in a frame."""
    back = _quaternion(frame) * np.array([1, -1, -1, -1], np.float32)
    return np.asarray(rotate(back, np.asarray(point - frame[:3], np.float32)), float)


def _quaternion(pose: Pose) -> Float32[np.ndarray, "4"]:
    return np.asarray(pose[3:], np.float32)


def heading(pose: Pose) -> float:
    """Return how far an object is turned about the vertical, degrees."""
    return math.degrees(float(headings(_quaternion(pose))))


def stands(pose: Pose) -> bool:
    """Return whether an object stands as it was made, turned about the vertical at most."""
    return float(uprightness(_quaternion(pose))) > STANDS


def turned(position: Point, turn: float) -> Pose:
    """Return the pose of an object that stands with its centre at a position, turned by `turn` degrees."""
    half = math.radians(turn) / 2
    return np.array([*position, math.cos(half), 0.0, 0.0, math.sin(half)])


def poses_now(task: Task, world: World) -> dict[str, Pose]:
    """Return the pose of each object in `world`, a batch of one."""
    return {name: np.asarray(world.poses[0, i], float) for i, name in enumerate(task.object_names)}


def inside(task: Task, name: str, pose: Pose, other: str, place: Pose) -> bool:
    """Return whether an object at a pose and another at its own would overlap by more than a touch."""
    half, beyond = half_of(task.thing(name), pose), half_of(task.thing(other), place)
    return bool(np.all(np.abs(pose[:3] - place[:3]) < half + beyond - 2 * TOUCHING * np.minimum(half, beyond)))


def carriers(task: Task, world: World, name: str, pose: Pose, others: Mapping[str, Pose]) -> list[str]:
    """Return what lies right under an object at a pose, with the other objects where `others` says: names of objects, then
    the kit."""
    half = half_of(task.thing(name), pose)
    found = []
    for other, place in others.items():
        reach = half + half_of(task.thing(other), place)
        away = pose[:3] - place[:3]
        if np.all(np.abs(away[:2]) < 0.95 * reach[:2]) and abs(away[2] - reach[2]) < 0.8 * half[2]:
            found.append((float(np.linalg.norm(away[:2])), other))
    kits = [
        kit.name
        for kit, origin in zip(task.kits, world.kits[0], strict=True)
        if np.all(np.abs(pose[:2] - origin[:2]) < kit.half)
    ]
    return [*(other for _, other in sorted(found)), *kits]
