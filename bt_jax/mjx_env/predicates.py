"""What is true of objects in a scene, for whole batches of states; NumPy or JAX. `behaviors.geometry` says the same for
single objects.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.behaviors.geometry import GEOMETRY
from bt_jax.mjx_env.driving import within_reach
from bt_jax.mjx_env.surfaces import (
    Outlines,
    Surfaces,
    fixed_surfaces,
    half_extents,
    joined,
    meet,
    object_surfaces,
    outlines,
    standing_extents,
)
from bt_jax.mjx_env.world import Array, World, distances, frames, headings, namespace, rotate, to_world, uprightness
from bt_jax.tasks import Target, Task

__all__ = [
    "graspable",
    "in_own_target",
    "is_clear",
    "is_seen",
    "is_upright",
    "loose",
    "off_floor",
    "reachable",
    "stands_in",
    "turn_error",
]


def reachable(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects the gripper reaches: those not on the floor and, where the robot drives, near enough to it."""
    if task.robot.base is None:
        return off_floor(world, task)
    return off_floor(world, task) & within_reach(world, task, world.poses[..., :3])


def off_floor(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects are not below the lowest table's top, so not on the floor."""
    return world.poses[..., 2] > _least_heights(task)


def loose(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects the gripper may take as an instance of a part once they are within reach: those that are clear,
    graspable, not on the floor, not held, and in no target of their own."""
    objects = np.arange(len(task.objects), dtype=np.int8)
    free = is_clear(world, task) & off_floor(world, task) & graspable(world, task)
    return free & ~in_own_target(world, task) & (world.held[:, None] != objects[None])


@functools.lru_cache(maxsize=16)
def _least_heights(task: Task) -> Float32[np.ndarray, "1 B"]:
    """Return the world z above which the middle of each object is not below the lowest table's top."""
    heights = np.array([[thing.height for thing in task.objects]], np.float32)
    lowest = np.float32(min(table.top for table in task.tables))
    return lowest - np.float32(GEOMETRY.seated) * heights


def is_seen(world: World) -> Bool[Array, "S B"]:
    """Return of which objects it is known where they are: those in sight, and the one that the gripper holds."""
    xp = namespace(world.poses)
    if world.unseen is None:
        return xp.ones(world.poses.shape[:-1], bool)
    objects = np.arange(world.poses.shape[-2], dtype=np.int8).reshape((1,) * world.held.ndim + (-1,))
    return ~world.unseen | (world.held[..., None] == objects)


def is_clear(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects have nothing on top."""
    return ~namespace(world.poses).any(_rests_on(world, task), axis=-2)


def is_upright(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects stand on their foot or, cuboids, on the opposite face; cubes on any."""
    cubes = np.array([thing.is_cube for thing in task.objects])
    cubes = cubes.reshape((1,) * (world.poses.ndim - 2) + cubes.shape)
    return cubes | (namespace(world.poses).abs(uprightness(world.poses[..., 3:])) > np.float32(GEOMETRY.upright))


def _rests_on(world: World, task: Task) -> Bool[Array, "S B B"]:
    """Return at [s, i, j] whether object i stands over object j, close enough to rest on it; a held one rests on nothing."""
    xp = namespace(world.poses)
    if task.all_cubes:
        middle, lower, least, most = _cubes_rest(task)
    else:
        middle, lower, least, most = _rest(standing_extents(task, world.poses[..., 3:]))
    offset = world.poses[..., :, None, :3] - world.poses[..., None, :, :3]
    over = xp.abs(offset[..., :2]) < middle
    gap = offset[..., 2] - lower
    held = world.held[..., None] == np.arange(len(task.objects), dtype=np.int8)[None]
    either = held[..., :, None] | held[..., None, :]
    return (gap > least) & (gap < most) & over[..., 0] & over[..., 1] & ~either


def _rest(half: Float32[Array, "*S B 3"]) -> tuple[Array, Array, Array, Array]:
    """Return for each pair of objects, an upper and a lower one, how far apart their middles may be along x and y, what is
    taken off the height of one over the other, and between which bounds the rest has to be."""
    xp = namespace(half)
    middle = half[..., :, None, :] + half[..., None, :, :]
    height = 2 * xp.minimum(half[..., :, None, 2], half[..., None, :, 2])
    least, most = np.float32(GEOMETRY.above_least) * height, np.float32(GEOMETRY.above_most) * height
    return middle[..., :2], middle[..., 2] - height, least, most


@functools.lru_cache(maxsize=16)
def _cubes_rest(task: Task) -> tuple[Array, Array, Array, Array]:
    """Return what `_rest` does for cubes, which extend alike however they lie (NumPy)."""
    upright = np.tile(np.array([1, 0, 0, 0], np.float32), (1, len(task.objects), 1))
    return _rest(standing_extents(task, upright))


def turn_error(
    quaternion: Float32[Array, "*#S 4"],
    frame: Float32[Array, "*#S 4"],
    wanted: Float32[Array, "*#S"],
    symmetry: Float32[Array, "*#S"],
) -> Float32[Array, "*S"]:
    """Return by how much, radians, an object is turned about the vertical too far from the `wanted` turn in a frame, to
    the nearest of the turns in which it looks alike (`symmetry`, 0 for all); NaN where no turn is wanted."""
    xp = namespace(quaternion)
    period = xp.where(symmetry > 0, symmetry, np.float32(1))
    off = headings(quaternion) - headings(frame) - wanted
    return xp.where(symmetry > 0, off - period * xp.round(off / period), off * 0)


def in_own_target(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects are instances that stand in a target of theirs, which names them or their part: in each target
    the nearest of those that are at it."""
    xp = namespace(world.poses)
    targets = [target for target in task.targets if task.thing(task.instances[target.object][0]).part]
    if not targets:
        return xp.zeros(world.poses.shape[:-1], bool)
    there, away = stands_in(world, task, targets)
    nearest = xp.argmin(xp.where(there, away, np.float32(np.inf)), axis=1)
    objects = np.arange(len(task.objects), dtype=np.int8)
    return (there & (nearest.astype(np.int8)[:, None] == objects[None, :, None])).any(axis=-1)


def stands_in(
    world: World, task: Task, targets: Sequence[Target]
) -> tuple[Bool[Array, "S B T"], Float32[Array, "S B T"]]:
    """Return which objects are at which of some targets that they are meant for, upright, turned as it says and not held;
    and how far, metres, every object is from each. No object stands in its own frame."""
    xp = namespace(world.poses)
    objects = np.arange(len(task.objects), dtype=np.int8)
    frame = np.array([task.frames.index(target.frame) for target in targets])
    meant = np.array([[name in task.instances[t.object] for t in targets] for name in task.object_names])
    own = meant & (objects[:, None] != frame)
    places = frames(world, task)
    goal = to_world(places, frame, np.array([target.position for target in targets], np.float32))
    away = distances(world.poses[:, :, None, :3], goal[:, None])
    free = is_upright(world, task) & (world.held[:, None] != objects[None])
    there = own[None] & free[..., None] & (away < np.float32(task.episode.tolerance))
    wanted = np.array([math.nan if t.turn is None else math.radians(t.turn) for t in targets], np.float32)
    if not np.isnan(wanted).all():
        symmetry = np.array([math.radians(thing.symmetry) for thing in task.objects], np.float32)
        turned = turn_error(
            world.poses[:, :, None, 3:], places[:, None, frame, 3:], wanted[None, None], symmetry[None, :, None]
        )
        most = np.float32(math.radians(task.episode.turn_tolerance))
        there = there & (np.isnan(wanted)[None, None] | (xp.abs(turned) < most))
    return there, away


def graspable(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects stand so that the gripper can take them: along a pair of upright parallel faces that fits the
    opening, or along one of the world's axes if they are round, where both fingers, squares of `finger_room` along these
    faces, have room beside, down to the middle."""
    xp = namespace(world.poses)
    standing = is_upright(world, task)
    if not task.finger_room:
        return standing
    surfaces, high = _beside(world, task)
    middles, room = world.poses[..., :3], np.float32(task.finger_room)
    is_round = np.array([thing.shape == "cylinder" for thing in task.objects])
    unturned = xp.asarray([1, 0, 0, 0], np.float32)[None, None]
    turns = xp.where(is_round[None, :, None], unturned, world.poses[..., 3:])
    axes = [rotate(turns, unit[None, None]) for unit in np.eye(3, dtype=np.float32)]
    steepest = xp.argmax(xp.stack([xp.abs(axis[..., 2]) for axis in axes], axis=-1), axis=-1)
    found = xp.zeros(standing.shape, bool)
    for i in (0, 1):
        axis = xp.where((steepest == i)[..., None], axes[2], axes[i])  # a cube may lie on any face
        away = np.array([thing.size[i] for thing in task.objects], np.float32) / 2 + room / 2
        along = axis[..., :2] / xp.sqrt(xp.sum(axis[..., :2] ** 2, axis=-1, keepdims=True))
        edges = along[..., None, :]
        square = Outlines(np.full(edges.shape, room / 2, np.float32), edges, np.zeros(edges.shape[:-1], bool))
        free = np.array([thing.size[i] <= task.gripper_opening for thing in task.objects])[None]
        for side in (-1, 1):
            finger = middles + side * away[None, :, None] * axis
            apart = surfaces.centre[:, None] - finger[..., None, :2]
            free = free & ~meet(square, _of_each(surfaces), apart, among=high).any(axis=-1)
        found = found | free
    return found & standing


def _beside(world: World, task: Task) -> tuple[Surfaces, Bool[Array, "S B M"]]:
    """Return everything that fingers may meet, with what it covers, and which of it is as high as fingers go that take an
    object: from its middle to its top."""
    xp = namespace(world.poses)
    quaternion = world.poses[..., 3:]
    fixed, objects = fixed_surfaces(task, world.kits), object_surfaces(task, world.poses)
    surfaces = joined(fixed, dataclasses.replace(objects, outlines=outlines(task.objects, quaternion)))
    bottoms = world.poses[..., 2] - half_extents(task.objects, quaternion)[..., 2]
    top = world.poses[..., 2] + standing_extents(task, quaternion)[..., 2]
    low = xp.concatenate([xp.full(fixed.top.shape, -np.inf, np.float32), bottoms], axis=1)[:, None] < top[..., None]
    high = low & (surfaces.top[:, None] > world.poses[..., 2, None])
    count = len(task.objects)
    return surfaces, high & ~np.eye(count, surfaces.top.shape[1], k=surfaces.top.shape[1] - count, dtype=bool)[None]


def _of_each(surfaces: Surfaces) -> Outlines:
    """Return what surfaces cover, for each object."""
    assert surfaces.outlines is not None
    half, along, is_round = surfaces.outlines.half, surfaces.outlines.along, surfaces.outlines.is_round
    return Outlines(half[:, None], along[:, None], is_round[:, None])
