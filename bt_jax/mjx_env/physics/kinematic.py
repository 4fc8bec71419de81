"""The `kinematic` level: no dynamics. A box drops to its support; one whose centre has no support topples off it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.mjx_env.physics.protocol import AtOnce, Settled
from bt_jax.mjx_env.surfaces import (
    Outlines,
    Surfaces,
    fixed_surfaces,
    joined,
    object_surfaces,
    outline_of,
    overlaps,
    standing_extents,
    support_height,
)
from bt_jax.mjx_env.world import Array, namespace
from bt_jax.tasks import Task

__all__ = ["Kinematic", "settle"]

TOPPLES = 6  # a box that falls over an edge may meet another; the floor ends it
LEVEL = 0.01  # surfaces within this part of a box's size of the highest carry it together


@dataclasses.dataclass(frozen=True)
class Kinematic:
    """The kinematic level behind the interface of the physics backends."""

    task: Task
    name: str = "kinematic"
    description: str = "no dynamics, objects drop to their support and topple if they have none"

    @property
    def stepper(self) -> AtOnce:
        """See `CompiledPhysics.stepper`."""
        return AtOnce(self.settle)

    def settle(
        self, kits: Float32[Array, "S T 3"], poses: Float32[Array, "S B 7"], present: Bool[Array, "S B"]
    ) -> Settled:
        """See `Physics.settle`; NumPy or JAX."""
        return settle(self.task, kits, poses, present)


def settle(
    task: Task, kits: Float32[Array, "S T 3"], poses: Float32[Array, "S B 7"], present: Bool[Array, "S B"]
) -> Settled:
    """Let objects fall, the lowest first; NumPy or JAX. See `Physics.settle`."""
    xp = namespace(poses)
    count = len(task.objects)
    start, done = poses, ~present & False
    fixed = fixed_surfaces(task, kits)
    order = xp.argsort(xp.where(present, poses[..., 2], np.float32(np.inf)), axis=1, stable=True)
    for rank in range(count):
        which = order[:, rank]
        chosen = which[:, None] == np.arange(count)[None]
        falls = chosen & present
        if xp is np and not falls.any():
            break
        pose = xp.sum(xp.where(chosen[..., None], poses, np.float32(0)), axis=1)
        surfaces = joined(fixed, object_surfaces(task, poses))
        usable = xp.concatenate([xp.ones(fixed.top.shape, bool), done], axis=1)
        half = standing_extents(task, pose[:, 3:], which)
        outline = outline_of(task, pose[:, 3:], which)
        pose = _drop(surfaces, usable, pose, half, outline)
        for _ in range(TOPPLES):
            before, toppled = pose, _topple(surfaces, usable, pose, half, outline)
            half, outline = (of(task, toppled[:, 3:], which) for of in (standing_extents, outline_of))
            pose = _drop(surfaces, usable, toppled, half, outline)
            if xp is np and np.array_equal(before, pose):
                break
        poses = xp.where(falls[..., None], pose[:, None], poses)
        done = done | falls
    reach = xp.sqrt(xp.sum((poses[..., :2] - start[..., :2]) ** 2, axis=-1))
    return Settled(poses, xp.ones(kits.shape[0], bool), xp.zeros(kits.shape[0], np.int32), reach)


def _drop(
    surfaces: Surfaces,
    usable: Array,
    pose: Float32[Array, "S 7"],
    half: Float32[Array, "S 3"],
    outline: Outlines | None,
) -> Array:
    xp = namespace(pose)
    high = half[:, 2]
    below = usable & (surfaces.top <= (pose[:, 2] - high + high * np.float32(2 * LEVEL))[:, None])
    height = support_height(surfaces, pose[:, :2], half[:, :2], below, outline) + high
    return xp.concatenate([pose[:, :2], height[:, None], pose[:, 3:]], axis=-1)


def _topple(
    surfaces: Surfaces,
    usable: Array,
    pose: Float32[Array, "S 7"],
    half: Float32[Array, "S 3"],
    outline: Outlines | None,
) -> Array:
    """Move an object whose centre is beside its support off that support, turned by a quarter; others stay."""
    xp = namespace(pose)
    xy, high = pose[:, :2], half[:, 2]
    bottom = pose[:, 2] - high
    level = xp.abs(surfaces.top - bottom[:, None]) < (high * np.float32(2 * LEVEL))[:, None]
    carries = (usable & level & overlaps(surfaces, xy, half[:, :2], outline))[..., None]
    low = xp.maximum(surfaces.centre - surfaces.half, (xy - half[:, :2])[:, None])
    top = xp.minimum(surfaces.centre + surfaces.half, (xy + half[:, :2])[:, None])
    low = xp.min(xp.where(carries, low, np.float32(np.inf)), axis=1)
    top = xp.max(xp.where(carries, top, np.float32(-np.inf)), axis=1)
    over = xp.maximum(xp.maximum(low - xy, xy - top), np.float32(0))  # how far the centre is out, along x and y
    along_x = over[:, 0] >= over[:, 1]
    falls = xp.any(over > 0, axis=1)
    up = xy > top
    edge = xp.where(up, top, low)
    clear = xp.where(up, edge + high[:, None], edge - high[:, None])  # on its side it is as wide as it was high
    axis = xp.stack([along_x, ~along_x], axis=1)
    new_xy = xp.where(axis & falls[:, None], clear, xy)
    turn = xp.where(xp.any(axis & up, axis=1), np.float32(1), np.float32(-1)) * np.float32(np.sqrt(0.5))
    turned = _quarter_turn(pose[:, 3:], xp.where(along_x, turn, np.float32(0)), xp.where(along_x, np.float32(0), -turn))
    quaternion = xp.where(falls[:, None], turned, pose[:, 3:])
    return xp.concatenate([new_xy, pose[:, 2:3], quaternion], axis=-1)


def _quarter_turn(
    quaternion: Float32[Array, "S 4"], about_y: Float32[Array, " S"], about_x: Float32[Array, " S"]
) -> Array:
    """Return (sqrt(1/2), about_x, about_y, 0) * quaternion (wxyz), so that a box tips over its edge in the world's frame."""
    xp = namespace(quaternion)
    a = np.float32(np.sqrt(0.5))
    w, x, y, z = (quaternion[:, i] for i in range(4))
    return xp.stack(
        [
            a * w - about_x * x - about_y * y,
            a * x + about_x * w + about_y * z,
            a * y + about_y * w - about_x * z,
            a * z + about_x * y - about_y * x,
        ],
        axis=-1,
    )
