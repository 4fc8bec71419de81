"""What an object can come to stand on: level rectangles, seen from above."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.mjx_env.world import Array, namespace
from bt_jax.tasks import Object, Task

__all__ = [
    "Surfaces",
    "fixed_surfaces",
    "half_extents",
    "joined",
    "object_surfaces",
    "overlaps",
    "standing_extents",
    "support_height",
    "surface_names",
]

TOUCH = 0.02  # objects that overlap by less than this part of their size count as side by side


@dataclasses.dataclass(frozen=True)
class Surfaces:
    """M axis-aligned rectangles for each of S states; z is the height of the top in the world, metres."""

    centre: Float32[Array, "S M 2"]
    half: Float32[Array, "S M 2"]
    top: Float32[Array, "S M"]


def fixed_surfaces(task: Task, kits: Float32[Array, "S T 3"]) -> Surfaces:
    """Return the floor, the tables, and the plate and the walls of every kit; `kits` are the origins of their frames."""
    xp = namespace(kits)
    tables = [(*t.position[:2], t.size[0] / 2, t.size[1] / 2, t.top) for t in task.tables]
    still = np.array([(0, 0, np.inf, np.inf, task.floor), *tables], np.float32)
    count = kits.shape[0]
    still = xp.broadcast_to(xp.asarray(still), (count, *still.shape))
    centre, half, top = [still[..., :2]], [still[..., 2:4]], [still[..., 4]]
    for k, kit in enumerate(task.kits):
        parts = [(0, 0, *kit.half, kit.plate), *((*middle, *across, kit.rim) for middle, across in kit.walls())]
        moving = np.array(parts, np.float32)
        moving = xp.broadcast_to(xp.asarray(moving), (count, *moving.shape))
        centre.append(moving[..., :2] + kits[:, k, None, :2])
        half.append(moving[..., 2:4])
        top.append(moving[..., 4] + kits[:, k, None, 2])
    return Surfaces(xp.concatenate(centre, axis=1), xp.concatenate(half, axis=1), xp.concatenate(top, axis=1))


def surface_names(task: Task) -> list[str]:
    """Return what each of the fixed surfaces belongs to: the floor, a table or a kit."""
    of_kits = [kit.name for kit in task.kits for _ in (kit.name, *kit.walls())]
    return ["the floor", *(table.name for table in task.tables), *of_kits]


def object_surfaces(task: Task, poses: Float32[Array, "S B 7"]) -> Surfaces:
    """Return the tops of the blocks around the objects that are parallel to the axes."""
    half = half_extents(task.objects, poses[..., 3:])
    return Surfaces(centre=poses[..., :2], half=half[..., :2], top=poses[..., 2] + half[..., 2])


def joined(first: Surfaces, second: Surfaces) -> Surfaces:
    """Return the surfaces of both."""
    xp = namespace(first.top)
    return Surfaces(
        centre=xp.concatenate([first.centre, second.centre], axis=1),
        half=xp.concatenate([first.half, second.half], axis=1),
        top=xp.concatenate([first.top, second.top], axis=1),
    )


def half_extents(objects: Sequence[Object], quaternion: Float32[Array, "*S B 4"]) -> Float32[Array, "*S B 3"]:
    """Return half the extents, along the world's axes, of B objects that are turned as the quaternions (wxyz) say."""
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    # In units of the longest edge, so that those of cubes are plain row sums of the absolute rotation matrix.
    longest = _for_each([thing.edge / 2 for thing in objects], quaternion)
    u, v, h = (_for_each([thing.size[i] / thing.edge for thing in objects], quaternion) for i in range(3))
    extents = [xp.abs(a) * u + xp.abs(b) * v + xp.abs(c) * h for a, b, c in rows]
    cylinders = [thing.shape == "cylinder" for thing in objects]
    if any(cylinders):
        is_round = _for_each(cylinders, quaternion) > 0
        axis = [row[2] for row in rows]
        of_round = [xp.sqrt(xp.maximum(1 - a * a, np.float32(0))) * u + xp.abs(a) * h for a in axis]
        extents = [xp.where(is_round, a, b) for a, b in zip(of_round, extents, strict=True)]
    return xp.stack([extent * longest for extent in extents], axis=-1)


def _for_each(values: Sequence[float | bool], quaternion: Float32[Array, "*S B 4"]) -> Float32[Array, "*#S B"]:
    """Return a number for each object with as many dimensions as the batch."""
    return np.array(values, np.float32).reshape((1,) * (quaternion.ndim - 2) + (len(values),))


def standing_extents(task: Task, quaternion: Float32[Array, "*S B 4"]) -> Float32[Array, "*S B 3"]:
    """Return half the extents, along the world's axes, by which objects stand on others: as `half_extents`, but those of a
    cube are half its edge however it lies."""
    xp = namespace(quaternion)
    edges = _for_each([thing.edge / 2 for thing in task.objects], quaternion)[..., None]
    if task.all_cubes:
        return xp.broadcast_to(xp.asarray(edges), (*quaternion.shape[:-1], 3))
    is_cube = _for_each([thing.is_cube for thing in task.objects], quaternion)[..., None] > 0
    return xp.where(is_cube, edges, half_extents(task.objects, quaternion))


def overlaps(surfaces: Surfaces, xy: Float32[Array, "S 2"], half: Float32[Array, "S 2"]) -> Bool[Array, "S M"]:
    """Return which surfaces lie under a block with half extents `half` at `xy`, by more than a touch."""
    xp = namespace(xy)
    reach = surfaces.half + (half * np.float32(1 - 2 * TOUCH))[:, None]
    return xp.all(xp.abs(surfaces.centre - xy[:, None]) < reach, axis=-1)


def support_height(
    surfaces: Surfaces, xy: Float32[Array, "S 2"], half: Float32[Array, "S 2"], usable: Bool[Array, "S M"]
) -> Float32[Array, " S"]:
    """Return the height of the highest usable surface under a block with half extents `half` at `xy`; the floor, the first
    surface, is always there."""
    xp = namespace(xy)
    under = overlaps(surfaces, xy, half) & usable
    return xp.max(xp.where(under, surfaces.top, surfaces.top[:, :1]), axis=1)
