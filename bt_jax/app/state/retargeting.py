"""Targets that a person changes: where an object should end, and how it should lie there.

Positions are of an object's centre, metres, in the world; turns are degrees about the vertical of the target's frame, None
where any will do. Targets go by the keys of `goals`. Impossible ones are refused with a UserError.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import check_kits, check_over_table
from bt_jax.app.state.extents import (
    Point,
    Pose,
    carriers,
    half_of,
    heading,
    in_frame,
    in_world,
    inside,
    poses_now,
    turned,
)
from bt_jax.app.state.goals import goals, kind_of, target_keys
from bt_jax.app.state.snapping import SNAP, slot_near
from bt_jax.app.units import length
from bt_jax.behaviors import gene_pool
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.surfaces import fixed_surfaces, joined, object_surfaces, outline_of, support_height
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Object, Target, Task, with_target
from bt_jax.tasks.slots import slot_position, slot_turn

__all__ = ["retarget", "spare_place", "untarget"]


def retarget(
    task: Task,
    physics: Physics,
    world: World,
    key: str,
    position: Point,
    frame: str | None = None,
    turn: float | None = None,
) -> Task:
    """Return the task with another target in place of that with a key, or with one more if there is none. Without a `frame`,
    the target is relative to what the object stands on: an object, a kit, or else the robot. A position close to a slot is
    moved into the slot, and takes its turn; one close to a place that evolution can use is moved there.

    Raise UserError if nothing carries the object there, it would not stay, or it would be inside something.
    """
    kind, keys, goal_of = kind_of(key), target_keys(task), goals(task, world)
    thing = task.thing(kind)
    name = goal_of[key].thing if key in keys else _stand_in(task, kind, {goal.thing for goal in goal_of.values()})
    ends = {goal.thing: goal.pose for goal in goal_of.values()}
    ends = {**poses_now(task, world), **ends}
    others = {other: pose for other, pose in ends.items() if other not in {name, *_dependent(task, kind)}}
    pose = turned(position, 0.0 if turn is None else turn)
    check_over_table(task, name, pose)
    if frame is None:
        frame = next(
            (one for one in carriers(task, world, name, pose, others) if _is_frame(task, one)), task.robot_frame
        )
    if frame == name or frame not in task.frames:
        raise UserError(f"{kind} cannot be placed relative to {frame}; measure it from something else")
    origin = ends.get(frame, np.asarray(frames(world, task)[0, task.frames.index(frame)], float))
    target = _snapped(task, kind, thing, frame, in_frame(origin, position), turn)
    turn_there = heading(ends[name]) if target.turn is None else heading(origin) + target.turn
    pose = turned(in_world(origin, np.array(target.position)), turn_there)
    check_kits(task, world, name, pose)
    for other in (goal.thing for goal in goal_of.values()):
        if other in others and inside(task, name, pose, other, others[other]):
            raise UserError(f"{kind} would be inside {other}, which should be there; put it beside or on top of it")
    _check_carried(task, world, kind, name, pose, others)
    changed = with_target(task, target, instead_of=keys.get(key), source="the target")
    _check_stays(changed, physics, world, key)
    return changed


def spare_place(task: Task, world: World, kind: str) -> Point:
    """Return where an object or an instance without a target is now. Raise UserError if all have one."""
    return poses_now(task, world)[_stand_in(task, kind, {goal.thing for goal in goals(task, world).values()})][:3]


def untarget(task: Task, key: str) -> Task:
    """Return the task without the target of a key."""
    rest = tuple(target for other, target in target_keys(task).items() if other != key)
    return dataclasses.replace(task, targets=rest)


def _stand_in(task: Task, kind: str, taken: set[str]) -> str:
    """Return an instance without a target. Raise UserError if all have one."""
    free = [name for name in task.instances[kind] if name not in taken]
    if not free:
        raise UserError(f"every {kind} has a target already; move one of those")
    return free[0]


def _is_frame(task: Task, name: str) -> bool:
    """Return whether a target may be relative to something: not to one of several instances, since any may be elsewhere."""
    return name not in task.object_names or len(task.instances.get(task.thing(name).part, ())) < 2


def _dependent(task: Task, name: str) -> set[str]:
    """Return the objects whose targets are relative to this object, directly or not."""
    found = {name}
    while more := {target.object for target in task.targets if target.frame in found} - found:
        found |= more
    return found - {name}


def _snapped(task: Task, kind: str, thing: Object, frame: str, local: Point, turn: float | None) -> Target:
    """Return the target in the slot or at the horizontal position of the gene that is close, if one is."""
    for kit in task.kits:
        slot = slot_near(kit, thing, local) if kit.name == frame else None
        if slot is not None:
            place, turn = slot_position(kit, slot, thing), slot_turn(kit, slot, thing)
            return Target(kind, place, frame, turn, f"{kit.name}.{slot.name}")
    genes = [gene for gene in gene_pool(task).leaves if gene.object == kind and gene.frame == frame]
    places = np.array([gene.position for gene in genes if gene.position is not None]).reshape(-1, 3)
    near = [place for place in places if abs(place[2] - local[2]) < thing.height / 2]
    best = min(near, key=lambda place: np.linalg.norm(place[:2] - local[:2]), default=None)
    if best is not None and np.linalg.norm(best[:2] - local[:2]) <= SNAP * max(thing.size[:2]):
        local = np.array([*best[:2], local[2]])
    x, y, z = (float(value) for value in np.round(local, 4) + 0.0)
    return Target(kind, (x, y, z), frame, turn)


def _check_stays(task: Task, physics: Physics, world: World, key: str) -> None:
    """Raise UserError if an object does not stay at its target when it and what should be around it are let go there."""
    where = {goal.thing: goal.pose for goal in goals(task, world).values()}
    goal = goals(task, world)[key]
    poses = world.poses.copy()
    for i, name in enumerate(task.object_names):
        if name in where:
            poses[0, i] = where[name]
    around = {*where, *(target.frame for target in task.targets)}
    present = np.array([[name in around for name in task.object_names]])
    rest = np.asarray(physics.settle(world.kits, poses, present).poses)[0, task.object_names.index(goal.thing), :3]
    if not np.linalg.norm(rest - goal.pose[:3]) < task.episode.tolerance:
        raise UserError(f"{kind_of(key)} would not stay there; put its middle over something level that carries it")


def _check_carried(task: Task, world: World, kind: str, name: str, pose: Pose, others: Mapping[str, Pose]) -> None:
    """Raise UserError if nothing is right below."""
    half = half_of(task.thing(name), pose)
    nowhere = turned(np.array([0, 0, -1e3]), 0.0)
    poses = np.array([[others.get(other, nowhere) for other in task.object_names]], np.float32)
    surfaces = joined(fixed_surfaces(task, world.kits), object_surfaces(task, poses))
    foot = pose[2] - half[2]
    below = surfaces.top <= foot + task.episode.tolerance
    at, reach = np.asarray(pose[None, :2], np.float32), np.asarray(half[None, :2], np.float32)
    outline = outline_of(task, np.asarray(pose[None, 3:], np.float32), np.array([task.object_names.index(name)]))
    gap = foot - float(support_height(surfaces, at, reach, below, outline)[0])
    if gap > task.episode.tolerance:
        raise UserError(f"{kind} would hang in the air, {length(gap)} above what is below it; put it lower")
