"""What a person arranges by hand: boxes in the scene, and where they should end.

Positions are of a box's centre, metres, in the world unless a frame is named. Impossible ones are refused with a UserError.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.behaviors import gene_pool
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import reachable, subgoals_by_sight
from bt_jax.mjx_env.skills import Released, settled_world
from bt_jax.mjx_env.surfaces import Surfaces, fixed_surfaces, object_surfaces, overlaps, support_height
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Table, Target, Task, with_targets
from bt_jax.tasks.support import kit_origin

__all__ = ["carriers", "fixed_layout", "free_layout", "goals", "kit_table", "move_kit", "put", "retarget", "untarget"]

Point = Float[np.ndarray, "3"]
INSIDE = 0.05  # boxes that overlap by less than this part of their size only touch
SNAP = 0.25  # a target this near, in sizes of its box, to a place that genes use is moved there
FLAT = 0.999  # |w| of the quaternion of a box that stands as it was made


def put(task: Task, physics: Physics, world: World, name: str, position: Point) -> World:
    """Return the world (a batch of one, NumPy) after a person has put a box down and everything rests again.

    Raise UserError if the box is in the gripper, off the tables, inside something, or does not stay.
    """
    index, size = _index(task, name), task.edge(name)
    if world.held[0] == index:
        raise UserError(f"{name} is in the gripper; wait until the robot has put it down")
    _check_over_table(task, name, position)
    _check_free(task, world, name, position)
    poses = world.poses.copy()
    poses[0, index] = (*position, 1, 0, 0, 0)
    present = (np.arange(len(task.objects)) != world.held[0])[None]
    # Everything settles, since what had stood on the box falls somewhere else than where the box is now.
    settled = physics.settle(world.kits, poses, present)
    if not np.asarray(settled.ok)[0]:
        raise UserError(f"the simulation diverged with {name} there; put it elsewhere")
    released = Released(dataclasses.replace(world, poses=poses), poses, present, np.array([-1], np.int32))
    after = settled_world(task, released, np.asarray(settled.poses))
    lost = reachable(world, task)[0] & ~reachable(after, task)[0]
    if lost.any():
        fallen = task.object_names[int(np.flatnonzero(lost)[0])]
        raise UserError(f"{fallen} would fall off the table; put {name} further in")
    moved = np.linalg.norm(after.poses[0, index, :2] - position[:2])
    if moved > size / 2:
        raise UserError(f"{name} would not stay there, it slides off; put its middle over something that carries it")
    return after


def kit_table(task: Task, world: World) -> str:
    """Return the name of the table on which the kit stands."""
    away = [np.linalg.norm(np.subtract(world.kits[0, 0, :2], table.position[:2])) for table in task.tables]
    return task.tables[int(np.argmin(away))].name


def move_kit(task: Task, world: World, table: str) -> World:
    """Return the world in which the kit, with its content, has changed places with what is on another table."""
    names = [each.name for each in task.tables]
    here, there = names.index(kit_table(task, world)), names.index(table)
    step = np.subtract(task.tables[there].position, task.tables[here].position).astype(np.float32)
    step[2] = kit_origin(task, task.tables[there])[2] - kit_origin(task, task.tables[here])[2]
    poses = world.poses.copy()
    for origin, direction in ((here, 1), (there, -1)):
        on = [_over(task.tables[origin], pose[:2]) for pose in world.poses[0]]
        poses[0, on, :3] += direction * step
    after = dataclasses.replace(world, kits=(world.kits + step).astype(np.float32), poses=poses)
    return dataclasses.replace(after, reached=subgoals_by_sight(task, after))


def goals(task: Task, world: World) -> dict[str, Point]:
    """Return where the object of each target should be once all targets are met, given where the others are now."""
    targets = {target.object: target for target in task.targets}
    now = dict(zip(task.frames, np.asarray(frames(world, task)[0, :, :3], float), strict=True))

    def goal(name: str) -> Point:
        if name not in targets:
            return now[name]
        return goal(targets[name].frame) + np.array(targets[name].position)

    return {name: goal(name) for name in targets}


def retarget(task: Task, physics: Physics, world: World, name: str, position: Point, frame: str | None = None) -> Task:
    """Return the task with another target for a box. Without a `frame`, the target is relative to what the box stands on: a
    box, the kit, or else the robot. A position close to one that evolution can use is moved there.

    Raise UserError if nothing carries the box there, it would not stay, or it would be inside something.
    """
    size = task.edge(name)
    rest = {box: np.asarray(world.poses[0, i, :3], float) for i, box in enumerate(task.object_names)}
    standing = {**rest, **goals(task, world)}
    others = {box: point for box, point in standing.items() if box not in {name, *_dependent(task, name)}}
    _check_over_table(task, name, position)
    _check_kit(task, world, name, position)
    if frame is None:
        frame = next(iter(carriers(task, world, name, position, others)), task.robot_frame)
    if frame == name or frame not in task.frames:
        raise UserError(f"{name} cannot be placed relative to {frame}; choose another frame")
    origin = standing.get(frame, np.asarray(frames(world, task)[0, task.frames.index(frame), :3], float))
    local = np.round(_snapped(task, name, frame, position - origin), 4) + 0.0
    for box in (target.object for target in task.targets):
        if box in others and _inside(origin + local, size, others[box], task.edge(box)):
            raise UserError(f"{name} would be inside {box}, which should be there; put it beside or on top of it")
    changed = with_targets(task, [Target(name, tuple(local.tolist()), frame)], source="the target")
    _check_carried(task, world, name, origin + local, others)
    _check_stays(changed, physics, world, name)
    return changed


def untarget(task: Task, name: str) -> Task:
    """Return the task without the target of a box. Raise UserError if it is the last one."""
    rest = tuple(target for target in task.targets if target.object != name)
    if not rest:
        raise UserError(f"{name} has the only target of the task; give another box one first")
    return dataclasses.replace(task, targets=rest)


def fixed_layout(task: Task, world: World) -> Task:
    """Return the task that always starts as the world is now. Raise UserError if a box is held or tilted."""
    if world.held[0] >= 0:
        raise UserError(f"{task.object_names[int(world.held[0])]} is in the gripper; put it down first")
    places = []
    for name, pose in zip(task.object_names, world.poses[0].astype(float), strict=True):
        if abs(pose[3]) < FLAT:
            raise UserError(f"{name} does not stand upright; drag it to a level place first")
        x, y, z = (round(float(value), 4) + 0.0 for value in pose[:3] - task.robot_position)
        places.append(Target(name, (x, y, z), task.robot_frame))
    layout = dataclasses.replace(task.layout, kit=kit_table(task, world), stack=(), fixed=tuple(places))
    return dataclasses.replace(task, layout=layout)


def free_layout(task: Task, base: Task) -> Task:
    """Return the task with boxes that start as in another task, at random places."""
    return dataclasses.replace(task, layout=dataclasses.replace(base.layout, fixed=()))


def _index(task: Task, name: str) -> int:
    if name not in task.object_names:
        raise UserError(f"there is no box '{name}'; choose one of {', '.join(task.object_names)}")
    return task.object_names.index(name)


def _over(table: Table, point: Float[np.ndarray, "2"]) -> bool:
    return bool(np.all(np.abs(np.subtract(point, table.position[:2])) <= np.array(table.size[:2]) / 2))


def _check_over_table(task: Task, name: str, position: Point) -> None:
    if not np.all(np.isfinite(position)):
        raise UserError(f"the place for {name} is not a number; give x, y and z")
    tables = [table for table in task.tables if _over(table, position[:2])]
    if not tables:
        raise UserError(f"there is no table there, out of reach for {name}; put it over one of the tables")
    size = task.edge(name)
    if position[2] - size / 2 < tables[0].top - INSIDE * size:
        raise UserError(f"{name} would be inside {tables[0].name}; put it higher")
    if position[2] > tables[0].top + 10 * size:
        raise UserError(f"{name} would be too high, out of reach; put it lower")


def _check_free(task: Task, world: World, name: str, position: Point) -> None:
    size = task.edge(name)
    for i, other in enumerate(task.objects):
        if other.name != name and _inside(position, size, np.asarray(world.poses[0, i, :3]), other.edge):
            raise UserError(f"{name} would be inside {other.name}; put it beside or on top of it")
    _check_kit(task, world, name, position)


def _check_kit(task: Task, world: World, name: str, position: Point) -> None:
    """Raise UserError if the box would be inside the kit's plate or walls."""
    size, kit = task.edge(name), fixed_surfaces(task, world.kits)
    first = 1 + len(task.tables)
    parts = Surfaces(kit.centre[:, first:], kit.half[:, first:], kit.top[:, first:])
    hit = overlaps(parts, np.array([position[:2]], np.float32), np.full((1, 2), size / 2, np.float32))[0]
    if np.any(hit & (parts.top[0] > position[2] - size / 2 + INSIDE * size)):
        raise UserError(f"{name} would be inside the kit's wall or floor; put it further in or higher")


def _inside(a: Point, size: float, b: Point, other: float) -> bool:
    return bool(np.all(np.abs(np.subtract(a, b)) < (size + other) / 2 - INSIDE * min(size, other)))


def _dependent(task: Task, name: str) -> set[str]:
    """Return the boxes whose targets are relative to this box, directly or not."""
    found = {name}
    while more := {target.object for target in task.targets if target.frame in found} - found:
        found |= more
    return found - {name}


def carriers(task: Task, world: World, name: str, position: Point, others: Mapping[str, Point]) -> list[str]:
    """Return what lies right under a box at a position, with the other boxes where `others` says: names of boxes, then the
    kit."""
    size = task.edge(name)
    found = []
    for box, point in others.items():
        reach = (size + task.edge(box)) / 2
        level = position[2] - point[2] - reach
        if np.all(np.abs(position[:2] - point[:2]) < 0.95 * reach) and abs(level) < 0.4 * size:
            found.append((float(np.linalg.norm(position[:2] - point[:2])), box))
    under = [box for _, box in sorted(found)]
    if np.all(np.abs(position[:2] - world.kits[0, 0, :2]) < task.kit.size[0] / 2):
        under.append(task.kit.name)
    return under


def _snapped(task: Task, name: str, frame: str, local: Point) -> Point:
    """Return the horizontal position of the closest gene, if one is close; the height stays."""
    genes = [gene for gene in gene_pool(task).leaves if gene.object == name and gene.frame == frame]
    places = np.array([gene.position for gene in genes if gene.position is not None]).reshape(-1, 3)
    size = task.edge(name)
    near = [place for place in places if abs(place[2] - local[2]) < size / 2]
    best = min(near, key=lambda place: np.linalg.norm(place[:2] - local[:2]), default=None)
    if best is None or np.linalg.norm(best[:2] - local[:2]) > SNAP * size:
        return local
    return np.array([*best[:2], local[2]])


def _check_stays(task: Task, physics: Physics, world: World, name: str) -> None:
    """Raise UserError if a box does not stay at its target when it and what should be around it are let go there."""
    where = goals(task, world)
    poses = world.poses.copy()
    for i, box in enumerate(task.object_names):
        if box in where:
            poses[0, i] = (*where[box], 1, 0, 0, 0)
    present = np.array([[box in where or box in {t.frame for t in task.targets} for box in task.object_names]])
    rest = np.asarray(physics.settle(world.kits, poses, present).poses)[0, _index(task, name), :3]
    if not np.linalg.norm(rest - where[name]) < task.episode.tolerance:
        raise UserError(f"{name} would not stay there; put its middle over something level that carries it")


def _check_carried(task: Task, world: World, name: str, goal: Point, others: Mapping[str, Point]) -> None:
    """Raise UserError if nothing is right below."""
    size = task.edge(name)
    poses = world.poses.copy()
    for i, box in enumerate(task.object_names):
        poses[0, i] = (*others.get(box, (0, 0, -100 * size)), 1, 0, 0, 0)
    fixed, movable = fixed_surfaces(task, world.kits), object_surfaces(task, poses)
    surfaces = Surfaces(
        np.concatenate([fixed.centre, movable.centre], axis=1),
        np.concatenate([fixed.half, movable.half], axis=1),
        np.concatenate([fixed.top, movable.top], axis=1),
    )
    below = surfaces.top <= goal[2] - size / 2 + task.episode.tolerance
    top = support_height(surfaces, np.array([goal[:2]], np.float32), np.full((1, 2), size / 2, np.float32), below)
    gap = goal[2] - size / 2 - float(top[0])
    if gap > task.episode.tolerance:
        raise UserError(f"{name} would hang in the air, {100 * gap:.0f} cm above what is below it; put it lower")
