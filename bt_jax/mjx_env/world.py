"""The state of the scene between two ticks, and the frames in it.

Functions take NumPy or JAX arrays alike and return the same kind: NumPy for small batches on the host, without any
compilation, and JAX inside compiled loops.
"""

from __future__ import annotations

import dataclasses
import math
from types import ModuleType
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, Int8, Int32, Shaped

from bt_jax.behaviors.geometry import BASE, GEOMETRY
from bt_jax.behaviors.pose import Pose
from bt_jax.tasks import Task

__all__ = [
    "Array",
    "World",
    "concatenate",
    "distances",
    "frames",
    "headings",
    "leveled",
    "namespace",
    "order_of_rows",
    "poses_by_name",
    "rotate",
    "row_names",
    "snap",
    "take",
    "to_world",
    "turned_about_vertical",
    "uprightness",
    "world_keys",
]

Array: TypeAlias = Any  # NumPy's or JAX's, and a function returns the kind it was given, which no union can say

POSITION_GRID = 1e-4  # metres
ROTATION_GRID = 1e-3  # of a quaternion's components: about 0.1 mm at the corner of a 0.1 m cube
EIGHTH = math.sqrt(0.5)  # sine and cosine of half a right angle
TO_LEVEL = np.array(  # turns after which the z axis is what the x, y or z axis was, or its opposite
    [
        [EIGHTH, 0, EIGHTH, 0],
        [EIGHTH, -EIGHTH, 0, 0],
        [1, 0, 0, 0],
        [EIGHTH, 0, -EIGHTH, 0],
        [EIGHTH, EIGHTH, 0, 0],
        [0, 1, 0, 0],
    ],
    np.float32,
)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class World:
    """A batch of S states at rest. Positions are metres in the world frame, quaternions (w, x, y, z)."""

    kits: Float32[Array, "*S T 3"]  # origins of the kits' frames, whose axes are the world's
    poses: Float32[Array, "*S B 7"]  # of the objects' centres: position, quaternion
    held: Int8[Array, "*S"]  # index of the object in the gripper, or -1
    gripper_open: Bool[Array, "*S"]  # the gripper
    reached: Bool[Array, "*S G"]  # subgoals that have held
    unseen: Bool[Array, "*S B"] | None = None  # objects that nobody sees now; None where the task has no such fault
    base: Float32[Array, "*S 2"] | None = None  # where a mobile base stands; None where the robot does not drive


def namespace(array: Array) -> ModuleType:
    """Return numpy or jax.numpy, whichever `array` belongs to."""
    return jnp if isinstance(array, jax.Array) else np


def take(world: World, index: int | slice | Array) -> World:
    """Return the states at `index` along the first dimension."""
    # Written out: walking a pytree takes longer than the rest for the few states of one tick.
    return World(
        world.kits[index],
        world.poses[index],
        world.held[index],
        world.gripper_open[index],
        world.reached[index],
        None if world.unseen is None else world.unseen[index],
        None if world.base is None else world.base[index],
    )


def concatenate(worlds: list[World]) -> World:
    """Join batches of states (NumPy)."""
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *worlds)


def distances(a: Float32[Array, "*#S 3"], b: Float32[Array, "*#S 3"]) -> Float32[Array, "*S"]:
    """Return distances between points, in their unit."""
    x, y, z = (a[..., i] - b[..., i] for i in range(3))  # NumPy takes long for sums of three
    return namespace(a).sqrt(x * x + y * y + z * z)


def rotate(quaternion: Float32[Array, "*S 4"], vector: Float32[Array, "*#S 3"]) -> Float32[Array, "*S 3"]:
    """Rotate vectors by unit quaternions (w, x, y, z)."""
    xp = namespace(quaternion)
    w, a, b, c = (quaternion[..., i] for i in range(4))
    x, y, z = (vector[..., i] for i in range(3))
    # v + 2 (w (u x v) + u x (u x v)), written out: much faster than cross products of small vectors in NumPy.
    p, q, r = 2 * (b * z - c * y), 2 * (c * x - a * z), 2 * (a * y - b * x)
    rotated = x + w * p + b * r - c * q, y + w * q + c * p - a * r, z + w * r + a * q - b * p
    return xp.stack(rotated, axis=-1)


def frames(world: World, task: Task) -> Float32[Array, "*S F 7"]:
    """Return the poses of all frames of the task in the world, in the order of `task.frames`: objects, kits, robot. Where
    things go wrong, those of objects are level."""
    xp = namespace(world.poses)
    poses = world.poses if task.faults is None else leveled(world.poses, task)
    upright = xp.asarray([1, 0, 0, 0], np.float32)
    batch = world.kits.shape[:-2]
    kits = xp.concatenate([world.kits, xp.broadcast_to(upright, (*world.kits.shape[:-1], 4))], axis=-1)
    robot = xp.concatenate([xp.asarray(task.robot_position, np.float32), upright])
    return xp.concatenate([poses, kits, xp.broadcast_to(robot, (*batch, 1, 7))], axis=-2, dtype=np.float32)


def leveled(poses: Float32[Array, "*S B 7"], task: Task) -> Float32[Array, "*S B 7"]:
    """Return the poses of objects with z upwards: for z that axis of a cube's which points up most nearly, as the robot's
    perception does, and what stands upside down is turned about its x axis. A cube that drops onto another face is the same
    cube: "on top of it" stays against gravity."""
    xp = namespace(poses)
    quaternion = poses[..., 3:]
    w, x, y, z = (quaternion[..., i] for i in range(4))
    up = xp.stack([2 * (x * z - w * y), 2 * (y * z + w * x), uprightness(quaternion)], axis=-1)
    cubes = np.array([thing.is_cube for thing in task.objects])
    cubes = cubes.reshape((1,) * (w.ndim - 1) + cubes.shape)
    axis = xp.where(cubes, xp.argmax(xp.abs(up), axis=-1), 2)
    rises = xp.take_along_axis(up, axis[..., None], axis=-1)[..., 0]
    least = np.where(cubes, np.float32(0), -np.float32(GEOMETRY.upright))
    face = xp.where(rises >= least, axis, axis + 3)
    p, q, r, s = (xp.asarray(TO_LEVEL)[face][..., i] for i in range(4))
    turned = [w * p - x * q - y * r - z * s, w * q + x * p + y * s - z * r, w * r - x * s + y * p + z * q]
    turned.append(w * s + x * r - y * q + z * p)
    level = xp.where((face == 2)[..., None], quaternion, xp.stack(turned, axis=-1))
    return xp.concatenate([poses[..., :3], level], axis=-1)


def poses_by_name(world: World, task: Task, row: int = 0) -> dict[str, Pose]:
    """Return the poses of all frames of the task in one state, and that of a base, as `behaviors.geometry` takes them."""
    poses = np.asarray(frames(take(world, slice(row, row + 1)), task))[0].tolist()
    named = dict(zip(task.frames, map(Pose.of, poses), strict=True))
    if world.base is not None:
        x, y = world.base[row].tolist()
        named[BASE] = Pose((x, y, task.robot_position[2]))
    return named


def to_world(
    frame_poses: Float32[Array, "*S F 7"], frame: np.ndarray, position: np.ndarray
) -> Float32[Array, "*S n 3"]:
    """Return world positions of n points, each given as index of its frame [n] and position in it [n, 3]."""
    poses = frame_poses[..., frame, :]
    points = namespace(frame_poses).asarray(position.reshape((1,) * (poses.ndim - 2) + position.shape), np.float32)
    return poses[..., :3] + rotate(poses[..., 3:], points)


def uprightness(quaternion: Float32[Array, "*S 4"]) -> Float32[Array, "*S"]:
    """Return the cosine of the angle between the own z axis and the vertical: 1 upright, 0 lying, -1 upside down."""
    return 1 - 2 * (quaternion[..., 1] ** 2 + quaternion[..., 2] ** 2)


def headings(quaternion: Float32[Array, "*S 4"]) -> Float32[Array, "*S"]:
    """Return the angle about the vertical, radians, of the own x axis, or of the y axis less a right angle where the x axis
    is steep."""
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    along_x = xp.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    along_y = xp.arctan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))
    steep = xp.abs(x * z - w * y) > np.float32(GEOMETRY.steep / 2)
    return xp.where(steep, along_y, along_x)


def turned_about_vertical(quaternion: Float[Array, "*S 4"], angle: Float[Array, "*S"]) -> Float[Array, "*S 4"]:
    """Return quaternions (wxyz) turned by angles, radians, about the world's vertical."""
    c, s = namespace(quaternion).cos(angle / 2), namespace(quaternion).sin(angle / 2)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    return namespace(quaternion).stack([c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w], axis=-1)


def snap(poses: Float32[Array, "*S 7"]) -> Float32[Array, "*S 7"]:
    """Round poses to the grid on which two states count as the same: 0.1 mm, and w >= 0."""
    # Products, since XLA turns divisions by constants into them, and NumPy must round alike.
    xp = namespace(poses)
    quaternion = poses[..., 3:]
    first = xp.where(quaternion[..., :1] < 0, np.float32(-1), np.float32(1))
    position = xp.round(poses[..., :3] * np.float32(1 / POSITION_GRID)) * np.float32(POSITION_GRID)
    rotation = xp.round(quaternion * first * np.float32(1 / ROTATION_GRID)) * np.float32(ROTATION_GRID)
    return xp.concatenate([position, rotation], axis=-1) + np.float32(0)


def world_keys(world: World) -> Int32[np.ndarray, "S n"]:
    """Return one row of integers for each state (NumPy, snapped): equal rows are equal states."""
    count = world.held.shape[0]
    grid = np.array([POSITION_GRID] * 3 + [ROTATION_GRID] * 4)
    parts = [
        np.rint(world.kits / POSITION_GRID).astype(np.int32).reshape(count, -1),
        np.rint(world.poses / grid).astype(np.int32).reshape(count, -1),
        world.held[:, None].astype(np.int32),
        world.gripper_open[:, None].astype(np.int32),
        world.reached.astype(np.int32),
    ]
    if world.unseen is not None:
        parts.append(world.unseen.astype(np.int32))
    if world.base is not None:
        parts.append(np.rint(world.base / POSITION_GRID).astype(np.int32))
    return np.concatenate(parts, axis=1)


def order_of_rows(rows: Shaped[np.ndarray, "S k n"]) -> Int[np.ndarray, "S k"]:
    """Return the order in which the k rows of each state come by their first number, equal ones by the next, and so on."""
    return np.lexsort(np.moveaxis(rows, 2, 0)[::-1], axis=1)


def row_names(rows: Shaped[np.ndarray, "S n"]) -> list[bytes]:
    """Return each row of numbers as a key of a dict."""
    return np.ascontiguousarray(rows).view(f"V{rows.shape[1] * rows.itemsize}").ravel().tolist()
