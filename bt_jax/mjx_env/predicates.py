"""What is true of objects in a scene, for whole batches of states; NumPy or JAX. `behaviors.geometry` says the same for
single objects.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from bt_jax.behaviors.geometry import GEOMETRY
from bt_jax.mjx_env.surfaces import Surfaces, fixed_surfaces, half_extents, object_surfaces, standing_extents
from bt_jax.mjx_env.world import Array, World, distances, frames, headings, namespace, rotate, to_world, uprightness
from bt_jax.tasks import Target, Task

__all__ = ["graspable", "in_own_target", "is_clear", "is_upright", "reachable", "stands_in", "turn_error"]


def reachable(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects the gripper reaches: those not below the lowest table's top, so not on the floor."""
    return world.poses[..., 2] > _least_heights(task)


@functools.lru_cache(maxsize=16)
def _least_heights(task: Task) -> Float32[np.ndarray, "1 B"]:
    """Return the world z above which the middle of each object is not below the lowest table's top."""
    heights = np.array([[thing.height for thing in task.objects]], np.float32)
    lowest = np.float32(min(table.top for table in task.tables))
    return lowest - np.float32(GEOMETRY.seated) * heights


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
    """Return which objects stand so that the gripper can take them: along a pair of parallel faces that fits the opening, or
    along one of the world's axes if they are round, where both fingers have `finger_room` beside, down to the middle."""
    xp = namespace(world.poses)
    standing = is_upright(world, task)
    if not task.finger_room:
        return standing
    surfaces = [fixed_surfaces(task, world.kits), object_surfaces(task, world.poses)]
    bottoms = world.poses[..., 2] - half_extents(task.objects, world.poses[..., 3:])[..., 2]
    top = world.poses[..., 2] + standing_extents(task, world.poses[..., 3:])[..., 2]
    is_round = np.array([thing.shape == "cylinder" for thing in task.objects])
    unturned = xp.asarray([1, 0, 0, 0], np.float32)[None, None]
    turns = xp.where(is_round[None, :, None], unturned, world.poses[..., 3:])
    found = xp.zeros(standing.shape, bool)
    for axis in (0, 1):
        half = np.array([thing.size[axis] / 2 for thing in task.objects], np.float32)
        free = np.array([thing.size[axis] <= task.gripper_opening for thing in task.objects])[None]
        for side in (-1, 1):
            away = np.zeros((len(task.objects), 3), np.float32)
            away[:, axis] = side * (half + task.finger_room / 2)
            finger = world.poses[..., :3] + rotate(turns, away[None])
            walls, others = (_hits(one, finger, task.finger_room) for one in surfaces)
            walls = walls & (surfaces[0].top[:, None] > world.poses[..., 2, None])
            beside = (surfaces[1].top[:, None] > world.poses[..., 2, None]) & (bottoms[:, None] < top[..., None])
            others = others & beside & ~np.eye(len(task.objects), dtype=bool)[None]
            free = free & ~walls.any(axis=-1) & ~others.any(axis=-1)
        found = found | free
    return found & standing


def _hits(surfaces: Surfaces, finger: Float32[Array, "S B 3"], room: float) -> Bool[Array, "S B M"]:
    """Return which surfaces, seen from above, a square finger with edge `room` meets."""
    reach = surfaces.half[:, None] + np.float32(room / 2)
    return namespace(finger).all(
        namespace(finger).abs(surfaces.centre[:, None] - finger[..., None, :2]) < reach, axis=-1
    )
