"""The idealized gripper: what a command does to a state before gravity and contacts take over, and after.

`pick` takes the object rigidly and lifts it; `place` carries it over the pose and lowers it until it is there, or until it
touches something, and lets go; `open_gripper` drops what is held; `look` moves nothing. `approach` moves the base by one
step, with what is held above it.
"""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32

from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.driving import drive, stations_near
from bt_jax.mjx_env.predicates import turn_error
from bt_jax.mjx_env.semantics import LeafSemantics, taken_by
from bt_jax.mjx_env.surfaces import (
    fixed_surfaces,
    joined,
    object_surfaces,
    outline_of,
    standing_extents,
    support_height,
)
from bt_jax.mjx_env.world import Array, World, frames, namespace, rotate, snap, turned_about_vertical
from bt_jax.tasks import Task

__all__ = ["LIFT", "Mishaps", "Released", "act", "reach", "settled_world"]

LIFT = 1.0  # height by which a picked object is raised, in its longest edges


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Released:
    """A state in mid-command: what has to settle."""

    world: World  # the held object, if any, at its new pose; nothing has moved otherwise
    poses: Float32[Array, "S B 7"]  # where every object starts to fall from
    present: Bool[Array, "S B"]  # objects that gravity and contacts act on: all but the held one
    box: Int32[Array, " S"]  # the object that was taken or let go, -1 where none


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Mishaps:
    """What goes wrong as each of S commands is carried out."""

    slips: Bool[Array, " S"]  # a `pick` closes on nothing
    jams: Bool[Array, " S"]  # the gripper neither opens nor closes, and nothing changes
    share: Float32[Array, " S"]  # of the way, after which what is carried drops; 1 where it does not
    error: Float32[Array, "S 3"]  # of a `place`: along x and y, metres, and of the turn, radians


def act(
    semantics: LeafSemantics, world: World, command: Int32[Array, " S"], mishaps: Mishaps | None = None
) -> Released:
    """Carry out one command in each state, up to the moment when the gripper lets go or has lifted.

    What drops on the way falls on what is below, beside a table on the nearest one: what lies on the floor is out of reach
    for good. The gripper has closed by then.
    """
    task, count = semantics.task, len(semantics.task.objects)
    xp = namespace(world.poses)
    objects = np.arange(count, dtype=np.int8)[None]
    held = world.held[:, None] == objects
    pick, place = command - 2, command - semantics.first_place
    is_pick, is_place = (pick >= 0) & (pick < semantics.num_picks), place >= 0
    opens, closes = (command == 0) | is_place, (command == 1) | is_pick
    dropped = None
    if mishaps is not None:
        dropped = is_place & (mishaps.share < 1) & ~mishaps.jams
        opens, closes = opens & ~mishaps.jams, closes & ~mishaps.jams
        is_place, is_pick = is_place & ~mishaps.jams, is_pick & ~mishaps.jams & ~mishaps.slips
    taken = taken_by(semantics, world, xp.where(is_pick, pick, 0)).astype(np.int8)
    picked = is_pick[:, None] & (taken[:, None] == objects)
    lift = np.array([[thing.edge for thing in task.objects]], np.float32) * np.float32(LIFT)
    raised = xp.concatenate([world.poses[..., :2], (world.poses[..., 2] + lift)[..., None], world.poses[..., 3:]], -1)
    poses = xp.where(picked[..., None], raised, world.poses)
    if semantics.places:
        carried = held & is_place[:, None]
        goal = _release_pose(semantics, world, xp.maximum(place, 0), mishaps)
        poses = xp.where(carried[..., None], goal[:, None], poses)
    base = world.base
    if semantics.approached:
        assert base is not None
        base = _driven(semantics, world, command - semantics.first_place + len(semantics.approached))
        above = xp.concatenate([base, xp.full((len(base), 1), task.robot_position[2], np.float32)], axis=1)[:, None]
        carried = xp.concatenate(
            [above + lift[..., None] * np.array([0, 0, 1], np.float32), world.poses[..., 3:]], axis=-1
        )
        has_moved = (base != world.base).any(axis=1, keepdims=True)
        poses = xp.where((held & has_moved)[..., None], carried, poses)
    held_after = xp.where(is_pick, taken, xp.where(opens, np.int8(-1), world.held))
    handled = xp.where(is_pick, taken.astype(np.int32), xp.where(opens, world.held.astype(np.int32), np.int32(-1)))
    after = dataclasses.replace(
        world,
        poses=poses,
        held=held_after.astype(np.int8),
        gripper_open=(world.gripper_open | (opens if dropped is None else opens & ~dropped)) & ~closes,
        base=base,
    )
    return Released(after, poses, held_after[:, None] != objects, handled.astype(np.int32))


def _driven(semantics: LeafSemantics, world: World, drive_to: Int32[Array, " S"]) -> Float32[Array, "S 2"]:
    """Return where the base is after one step towards what each state's drive approaches, or where it was where the command
    is no drive."""
    task, xp, names = semantics.task, namespace(world.poses), len(semantics.names)
    drives = (drive_to >= 0) & (drive_to < len(semantics.approached))
    if xp is np and not drives.any():
        return world.base
    name, rows = xp.clip(drive_to, 0, names - 1), np.arange(len(drives))
    near = semantics.stations_of_name(world, name)
    if semantics.spots:
        spot = xp.clip(drive_to - names, 0, len(semantics.spots) - 1)
        points = semantics.spot_points(world)[rows, spot]
        near = xp.where((drive_to < names)[:, None], near, stations_near(task, points[:, None])[:, 0])
    return drive(task, world.base, near & drives[:, None])


def reach(world: World, subgoals: Int32[Array, " S"]) -> World:
    """Return the states in which the tree has ticked subgoals, given as bits."""
    bits = np.arange(world.reached.shape[1], dtype=np.int32)[None]
    return dataclasses.replace(world, reached=world.reached | (subgoals[:, None] >> bits & 1 == 1))


def settled_world(task: Task, released: Released, poses: Float32[Array, "S B 7"]) -> World:
    """Return the state once everything is at rest at `poses`: snapped, with the subgoals that count as reached."""
    xp = namespace(poses)
    held = ~released.present[..., None]
    world = dataclasses.replace(released.world, poses=snap(xp.where(held, released.poses, poses)))
    return dataclasses.replace(world, reached=world.reached | subgoals_by_sight(task, world))


def _release_pose(
    semantics: LeafSemantics, world: World, place: Int32[Array, " S"], mishaps: Mishaps | None
) -> Float32[Array, "S 7"]:
    """Return where the gripper lets go of the held object: the goal, or over what is in the way of lowering it there. It is
    turned about the vertical, the shorter way, where the place says how it should lie, and otherwise as it was. What drops
    on the way is still turned as it was."""
    task = semantics.task
    xp = namespace(world.poses)
    rows = np.arange(world.held.shape[0])
    frame = frames(world, task)[rows, xp.asarray(semantics.place_frame)[place]]
    goal = frame[:, :3] + rotate(frame[:, 3:], xp.asarray(semantics.place_position)[place])
    held = xp.maximum(world.held, 0)
    turn = world.poses[rows, held, 3:]
    if semantics.turns:
        wanted = xp.asarray(semantics.place_turn)[place]
        error = turn_error(turn, frame[:, 3:], wanted, xp.asarray(semantics.symmetry)[held])
        as_it_was = xp.isnan(wanted) if mishaps is None else xp.isnan(wanted) | (mishaps.share < 1)
        turn = xp.where(as_it_was[:, None], turn, turned_about_vertical(turn, -error))
    if mishaps is not None:
        goal = goal + xp.concatenate([mishaps.error[:, :2], xp.zeros_like(goal[:, :1])], axis=1)
        turn = turned_about_vertical(turn, mishaps.error[:, 2])
        goal = _dropped(task, world.poses[rows, held], goal, mishaps.share, held)
    half = standing_extents(task, turn, held)
    surfaces = joined(fixed_surfaces(task, world.kits), object_surfaces(task, world.poses))
    usable = xp.concatenate(
        [
            xp.ones((rows.size, surfaces.top.shape[1] - len(task.objects)), bool),
            world.held[:, None] != np.arange(len(task.objects), dtype=np.int8)[None],
        ],
        axis=1,
    )
    support = support_height(surfaces, goal[:, :2], half[:, :2], usable, outline_of(task, turn, held))
    height = xp.maximum(goal[:, 2], support + half[:, 2])
    return xp.concatenate([goal[:, :2], height[:, None], turn], axis=-1)


def _dropped(
    task: Task,
    start: Float32[Array, "S 7"],
    goal: Float32[Array, "S 3"],
    share: Float32[Array, " S"],
    held: Int[Array, " S"],
) -> Float32[Array, "S 3"]:
    """Return where the way from `start` to `goal` ends: after a `share` below 1, on the table below or the nearest one, as
    deep as the floor, so that it rests on what is there."""
    xp = namespace(goal)
    reach = xp.asarray(np.array([thing.reach for thing in task.objects], np.float32))[held]
    middles = np.array([table.position[:2] for table in task.tables], np.float32)[None]
    halves = np.array([table.size[:2] for table in task.tables], np.float32)[None] / 2
    room = xp.maximum(halves - reach[:, None, None], np.float32(0))
    point = (start[:, :2] + share[:, None] * (goal[:, :2] - start[:, :2]))[:, None]
    over = xp.clip(point, middles - room, middles + room)
    away = xp.sum((over - point) ** 2, axis=-1)
    nearest = xp.take_along_axis(over, xp.argmin(away, axis=1)[:, None, None], axis=1)[:, 0]
    landing = xp.concatenate([nearest, xp.full_like(goal[:, :1], task.floor)], axis=1)
    return xp.where((share < 1)[:, None], landing, goal)
