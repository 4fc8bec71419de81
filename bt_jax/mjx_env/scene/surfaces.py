"""What a box can come to stand on: level rectangles, seen from above."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.mjx_env.world import Array, namespace
from bt_jax.tasks import Task

__all__ = ["Surfaces", "box_surfaces", "fixed_surfaces", "overlaps", "support_height"]

TOUCH = 0.02  # boxes that overlap by less than this part of their size count as side by side


@dataclasses.dataclass(frozen=True)
class Surfaces:
    """M axis-aligned rectangles for each of S states; z is the height of the top in the world, metres."""

    centre: Float32[Array, "S M 2"]
    half: Float32[Array, "S M 2"]
    top: Float32[Array, "S M"]


def fixed_surfaces(task: Task, kit: Float32[Array, "S 3"]) -> Surfaces:
    """Return the floor, the tables, the kit's plate and its walls; `kit` is the origin of the kit's frame."""
    xp = namespace(kit)
    tables = [(*t.position[:2], t.size[0] / 2, t.size[1] / 2, t.top) for t in task.tables]
    still = np.array([(0, 0, np.inf, np.inf, task.floor), *tables], np.float32)
    k = task.kit
    middle, across = k.size / 2 - k.wall_thickness / 2, k.wall_thickness / 2
    plate, rim = k.thickness / 2, k.thickness / 2 + k.wall_height
    moving = np.array(
        [
            (0, 0, k.size / 2, k.size / 2, plate),
            (middle, 0, across, k.size / 2, rim),
            (-middle, 0, across, k.size / 2, rim),
            (0, middle, k.size / 2, across, rim),
            (0, -middle, k.size / 2, across, rim),
        ],
        np.float32,
    )
    count = kit.shape[0]
    still = xp.broadcast_to(xp.asarray(still), (count, *still.shape))
    moving = xp.broadcast_to(xp.asarray(moving), (count, *moving.shape))
    return Surfaces(
        centre=xp.concatenate([still[..., :2], moving[..., :2] + kit[:, None, :2]], axis=1),
        half=xp.concatenate([still[..., 2:4], moving[..., 2:4]], axis=1),
        top=xp.concatenate([still[..., 4], moving[..., 4] + kit[:, None, 2]], axis=1),
    )


def box_surfaces(task: Task, poses: Float32[Array, "S B 7"]) -> Surfaces:
    """Return the boxes, each as the box around it that is parallel to the axes."""
    xp = namespace(poses)
    w, x, y, z = (poses[..., 3 + i] for i in range(4))
    # Row sums of the absolute rotation matrix: half the extent of a turned cube along each axis, in halves of its size.
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    extent = xp.stack([xp.abs(a) + xp.abs(b) + xp.abs(c) for a, b, c in rows], axis=-1)
    half = extent * np.array([[[box.size / 2] for box in task.boxes]], np.float32)
    return Surfaces(centre=poses[..., :2], half=half[..., :2], top=poses[..., 2] + half[..., 2])


def overlaps(surfaces: Surfaces, xy: Float32[Array, "S 2"], half: Float32[Array, " S"]) -> Bool[Array, "S M"]:
    """Return which surfaces lie under a box of half size `half` at `xy`, by more than a touch."""
    xp = namespace(xy)
    reach = surfaces.half + (half * np.float32(1 - 2 * TOUCH))[:, None, None]
    return xp.all(xp.abs(surfaces.centre - xy[:, None]) < reach, axis=-1)


def support_height(
    surfaces: Surfaces, xy: Float32[Array, "S 2"], half: Float32[Array, " S"], usable: Bool[Array, "S M"]
) -> Float32[Array, " S"]:
    """Return the height of the highest usable surface under a box of half size `half` at `xy`; the floor, the first
    surface, is always there."""
    xp = namespace(xy)
    under = overlaps(surfaces, xy, half) & usable
    return xp.max(xp.where(under, surfaces.top, surfaces.top[:, :1]), axis=1)
