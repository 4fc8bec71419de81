"""What an object can come to stand on, seen from above."""

from __future__ import annotations

import dataclasses
import functools
import operator
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32, Int, Shaped

from bt_jax.behaviors.geometry import GEOMETRY
from bt_jax.mjx_env.world import Array, headings, namespace, uprightness
from bt_jax.tasks import Object, Task

__all__ = [
    "Outlines",
    "Surfaces",
    "fixed_surfaces",
    "half_extents",
    "joined",
    "meet",
    "object_surfaces",
    "outline_of",
    "outlines",
    "overlaps",
    "standing_extents",
    "support_height",
    "surface_names",
]

TOUCH = 0.02  # objects that overlap by less than this part of their size count as side by side
FAR = 1e3  # metres; half the extents of an endless surface


@dataclasses.dataclass(frozen=True)
class Outlines:
    """What M objects cover in each of S states: rectangles with half the edges `half`, the first along the direction
    `along`, or circles of radius `half[0]`."""

    half: Float32[Array, "*S M 2"]
    along: Float32[Array, "*S M 2"]
    is_round: Bool[Array, "*S M"]


@dataclasses.dataclass(frozen=True)
class Surfaces:
    """M level surfaces for each of S states, with half the extents along the world's axes; `top` is the height in the world,
    metres. They are rectangles parallel to the axes where they have no outlines."""

    centre: Float32[Array, "S M 2"]
    half: Float32[Array, "S M 2"]
    top: Float32[Array, "S M"]
    outlines: Outlines | None = None


def fixed_surfaces(task: Task, kits: Float32[Array, "S T 3"]) -> Surfaces:
    """Return the floor, the tables, and the plate and the walls of every kit; `kits` are the origins of their frames."""
    xp = namespace(kits)
    centre, half, top, frame = _fixed(task)
    origins = xp.concatenate([xp.zeros((kits.shape[0], 1, 3), np.float32), kits], axis=1)
    origins = xp.take(origins, frame, axis=1)
    half = xp.broadcast_to(xp.asarray(half), (kits.shape[0], *half.shape))
    return Surfaces(origins[..., :2] + centre[None], half, origins[..., 2] + top[None])


@functools.lru_cache(maxsize=16)
def _fixed(task: Task) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return centre, half and top of the fixed surfaces in their frames, and the frames: 0 the world, then the kits."""
    rows: list[tuple[float, ...]] = [(0, 0, 0, np.inf, np.inf, task.floor)]
    rows += [(0, *t.position[:2], t.size[0] / 2, t.size[1] / 2, t.top) for t in task.tables]
    for k, kit in enumerate(task.kits, start=1):
        rows.append((k, 0, 0, *kit.half, kit.plate))
        rows += [(k, *middle, *across, kit.rim) for middle, across in kit.walls()]
    table = np.array(rows)
    parts = table[:, 1:].astype(np.float32)
    return parts[:, :2], parts[:, 2:4], parts[:, 4], table[:, 0].astype(int)


def surface_names(task: Task) -> list[str]:
    """Return what each of the fixed surfaces belongs to: the floor, a table or a kit."""
    of_kits = [kit.name for kit in task.kits for _ in (kit.name, *kit.walls())]
    return ["the floor", *(table.name for table in task.tables), *of_kits]


def object_surfaces(task: Task, poses: Float32[Array, "S B 7"]) -> Surfaces:
    """Return the tops of the objects."""
    half = half_extents(task.objects, poses[..., 3:])
    outlines = None if task.unturned_cubes else _outlines(_proportions(task.objects), poses[..., 3:])
    return Surfaces(poses[..., :2], half[..., :2], poses[..., 2] + half[..., 2], outlines)


def outline_of(task: Task, quaternion: Float32[Array, "S 4"], which: Int[Array, " S"]) -> Outlines | None:
    """Return what one object of each state covers, given as its index; None where all objects are cubes and none is meant
    to lie turned: they count as parallel to the axes however they lie."""
    if task.unturned_cubes:
        return None
    found = _outlines(_proportions(task.objects).of(which), quaternion)
    return Outlines(found.half[:, None], found.along[:, None], found.is_round[:, None])


def outlines(objects: Sequence[Object], quaternion: Float32[Array, "*S B 4"]) -> Outlines:
    """Return what B objects cover that are turned as the quaternions (wxyz) say."""
    return _outlines(_proportions(tuple(objects)), quaternion)


def _outlines(proportions: _Proportions, quaternion: Float32[Array, "*S B 4"]) -> Outlines:
    xp = namespace(quaternion)
    heading = headings(quaternion)
    c, s = xp.cos(heading), xp.sin(heading)
    half = _extents(proportions, quaternion, (c, s))[..., :2]
    upright = xp.abs(uprightness(quaternion)) > np.float32(GEOMETRY.upright)
    return Outlines(half, xp.stack([c, s], axis=-1), upright & _for_each(proportions.is_round, quaternion))


def _aligned(half: Float32[Array, "S M 2"]) -> Outlines:
    """Return rectangles that are parallel to the axes."""
    xp = namespace(half)
    along = xp.broadcast_to(xp.asarray([1, 0], np.float32), half.shape)
    return Outlines(xp.minimum(half, np.float32(FAR)), along, xp.zeros(half.shape[:-1], bool))


def joined(first: Surfaces, second: Surfaces) -> Surfaces:
    """Return the surfaces of both."""
    xp = namespace(first.top)
    both = None
    if first.outlines or second.outlines:
        one, other = (part.outlines or _aligned(part.half) for part in (first, second))
        both = Outlines(
            xp.concatenate([one.half, other.half], axis=1),
            xp.concatenate([one.along, other.along], axis=1),
            xp.concatenate([one.is_round, other.is_round], axis=1),
        )
    return Surfaces(
        centre=xp.concatenate([first.centre, second.centre], axis=1),
        half=xp.concatenate([first.half, second.half], axis=1),
        top=xp.concatenate([first.top, second.top], axis=1),
        outlines=both,
    )


def half_extents(objects: Sequence[Object], quaternion: Float32[Array, "*S B 4"]) -> Float32[Array, "*S B 3"]:
    """Return half the extents, along the world's axes, of B objects that are turned as the quaternions (wxyz) say."""
    return _extents(_proportions(tuple(objects)), quaternion)


def _extents(
    proportions: _Proportions, quaternion: Float32[Array, "*S B 4"], along: tuple[Array, Array] | None = None
) -> Float32[Array, "*S B 3"]:
    """Return half the extents along the world's axes, or along axes of which the first is the level unit vector `along`."""
    xp = namespace(quaternion)
    w, x, y, z = (quaternion[..., i] for i in range(4))
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    if along is not None:
        (c, s), (first, second, up) = along, rows
        rows = (
            tuple(c * a + s * b for a, b in zip(first, second, strict=True)),
            tuple(c * b - s * a for a, b in zip(first, second, strict=True)),
            up,
        )
    if proportions.all_cubes:
        extents = [xp.abs(a) + xp.abs(b) + xp.abs(c) for a, b, c in rows]
    else:
        u, v, h = (_for_each(edge, quaternion) for edge in proportions.edges)
        extents = [xp.abs(a) * u + xp.abs(b) * v + xp.abs(c) * h for a, b, c in rows]
    if proportions.any_round:
        axis = [row[2] for row in rows]
        of_round = [xp.sqrt(xp.maximum(1 - a * a, np.float32(0))) * u + xp.abs(a) * h for a in axis]
        is_round = _for_each(proportions.is_round, quaternion)
        extents = [xp.where(is_round, a, b) for a, b in zip(of_round, extents, strict=True)]
    return xp.stack(extents, axis=-1) * _for_each(proportions.half, quaternion)[..., None]


@dataclasses.dataclass(frozen=True)
class _Proportions:
    """The sizes of B objects."""

    half: Float32[Array, " B"]  # of the longest edge, metres
    edges: Float32[Array, "3 B"]  # in longest edges
    is_cube: Bool[Array, " B"]
    is_round: Bool[Array, " B"]
    all_cubes: bool
    any_round: bool

    def of(self, which: Int[Array, " n"]) -> _Proportions:
        """Return those of the objects with these indices."""
        xp = namespace(which)
        half, is_cube, is_round = (xp.asarray(one)[which] for one in (self.half, self.is_cube, self.is_round))
        return dataclasses.replace(
            self, half=half, edges=xp.asarray(self.edges)[:, which], is_cube=is_cube, is_round=is_round
        )


@functools.lru_cache(maxsize=64)
def _proportions(objects: tuple[Object, ...]) -> _Proportions:
    half = np.array([thing.edge / 2 for thing in objects], np.float32)
    edges = np.array([[thing.size[i] / thing.edge for thing in objects] for i in range(3)], np.float32)
    is_cube = np.array([thing.is_cube for thing in objects], bool)
    is_round = np.array([thing.shape == "cylinder" for thing in objects], bool)
    return _Proportions(half, edges, is_cube, is_round, bool(is_cube.all()), bool(is_round.any()))


def _for_each(values: Shaped[Array, " B"], quaternion: Float32[Array, "*S B 4"]) -> Shaped[Array, "*#S B"]:
    """Return a number for each object with as many dimensions as the batch."""
    return values.reshape((1,) * (quaternion.ndim - 2) + values.shape)


def standing_extents(
    task: Task, quaternion: Float32[Array, "*S B 4"], which: Int[Array, " B"] | None = None
) -> Float32[Array, "*S B 3"]:
    """Return half the extents, along the world's axes, by which objects stand on others: as `half_extents`, but those of a
    cube are half its edge however it lies. The objects are the task's, or those with the indices `which`."""
    xp = namespace(quaternion)
    proportions = _proportions(task.objects)
    if proportions.all_cubes:
        half = proportions.half if which is None else xp.asarray(proportions.half)[which]
        return xp.broadcast_to(xp.asarray(_for_each(half, quaternion)[..., None]), (*quaternion.shape[:-1], 3))
    if which is not None:
        proportions = proportions.of(which)
    half, is_cube = (_for_each(one, quaternion)[..., None] for one in (proportions.half, proportions.is_cube))
    return xp.where(is_cube, half, _extents(proportions, quaternion))


def overlaps(
    surfaces: Surfaces, xy: Float32[Array, "S 2"], half: Float32[Array, "S 2"], block: Outlines | None = None
) -> Bool[Array, "S M"]:
    """Return which surfaces lie under a block at `xy`, by more than a touch. It has half the extents `half`, and what it
    covers is its outline, one for each state; without one it is parallel to the axes."""
    xp = namespace(xy)
    if surfaces.outlines is None and block is None:
        reach = surfaces.half + (half * np.float32(1 - 2 * TOUCH))[:, None]
        return xp.all(xp.abs(surfaces.centre - xy[:, None]) < reach, axis=-1)
    above, below = block or _aligned(half[:, None]), surfaces.outlines or _aligned(surfaces.half)
    above = dataclasses.replace(above, half=above.half * np.float32(1 - 2 * TOUCH))
    return meet(above, below, surfaces.centre - xy[:, None])


def meet(
    one: Outlines, other: Outlines, apart: Float32[Array, "*#S 2"], among: Bool[Array, "*#S"] | bool = True
) -> Bool[Array, "*S"]:
    """Return which outlines overlap, of the pairs `among` all; `apart` is the way from the middle of the first to that of
    the other, metres. NumPy looks closely only at pairs whose circumscribed circles overlap."""
    if namespace(apart) is not np:
        return _meet(one, other, apart) & among
    near = _dot(apart, apart) <= np.square((_radius(one) + _radius(other)) * np.float32(1 + TOUCH))
    near = near & among
    pairs = np.nonzero(near)

    def gathered(outlines: Outlines) -> Outlines:
        whole = (np.broadcast_to(leaf, near.shape + leaf.shape[outlines.is_round.ndim :]) for leaf in _leaves(outlines))
        return Outlines(*(leaf[pairs] for leaf in whole))

    near[pairs] = _meet(gathered(one), gathered(other), np.broadcast_to(apart, (*near.shape, 2))[pairs])
    return near


def _leaves(outlines: Outlines) -> tuple[Array, Array, Array]:
    return outlines.half, outlines.along, outlines.is_round


def _radius(outlines: Outlines) -> Float32[Array, "*S"]:
    """Return the radii of the circumscribed circles."""
    xp, half = namespace(outlines.half), outlines.half
    return xp.where(outlines.is_round, half[..., 0], xp.sqrt(_dot(half, half)))


def _meet(one: Outlines, other: Outlines, apart: Float32[Array, "*#S 2"]) -> Bool[Array, "*#S"]:
    """Return whether outlines overlap: they do if their extents along every axis do (the separating axis theorem), those of
    the edges, and from a circle to the nearest point of the other outline."""
    xp = namespace(apart)
    nearest = xp.where(one.is_round[..., None], _outside(other, -apart), _outside(one, apart))
    distance = xp.sqrt(_dot(nearest, nearest))[..., None]
    between = xp.where(distance > 0, nearest / xp.maximum(distance, np.float32(1e-9)), np.array([1, 0], np.float32))
    axes = [between, one.along, _across(one.along), other.along, _across(other.along)]
    return functools.reduce(
        operator.and_,
        [xp.abs(_dot(apart, axis)) < _reach(one, axis) + _reach(other, axis) for axis in axes],
    )


def _outside(outline: Outlines, point: Float32[Array, "*#S 2"]) -> Float32[Array, "*#S 2"]:
    """Return the way from the nearest point of a rectangle, or from the middle of a circle, to a point."""
    xp = namespace(point)
    edges = outline.along, _across(outline.along)
    ways = []
    for i, edge in enumerate(edges):
        half = xp.where(outline.is_round, np.float32(0), outline.half[..., i])
        at = _dot(point, edge)
        ways.append((at - xp.clip(at, -half, half))[..., None] * edge)
    return ways[0] + ways[1]


def _dot(a: Float32[Array, "*#S 2"], b: Float32[Array, "*#S 2"]) -> Float32[Array, "*S"]:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1]  # NumPy takes long for sums of two


def _across(along: Float32[Array, "*S 2"]) -> Float32[Array, "*S 2"]:
    return namespace(along).stack([-along[..., 1], along[..., 0]], axis=-1)


def _reach(outline: Outlines, axis: Float32[Array, "*#S 2"]) -> Float32[Array, "*#S"]:
    """Return half the extents along an axis, a unit vector."""
    xp = namespace(axis)
    along, across = (xp.abs(_dot(edge, axis)) for edge in (outline.along, _across(outline.along)))
    of_rectangle = along * outline.half[..., 0] + across * outline.half[..., 1]
    return xp.where(outline.is_round, outline.half[..., 0], of_rectangle)


def support_height(
    surfaces: Surfaces,
    xy: Float32[Array, "S 2"],
    half: Float32[Array, "S 2"],
    usable: Bool[Array, "S M"],
    block: Outlines | None = None,
) -> Float32[Array, " S"]:
    """Return the height of the highest usable surface under a block (see `overlaps`); the floor, the first surface, is
    always there."""
    xp = namespace(xy)
    under = overlaps(surfaces, xy, half, block) & usable
    return xp.max(xp.where(under, surfaces.top, surfaces.top[:, :1]), axis=1)
