"""What a person arranges by hand: objects in the scene, kits, and the start of every episode.

Positions are of an object's centre, metres, in the world. Impossible ones are refused with a UserError.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.app.state.extents import TOUCHING, Point, Pose, half_of, heading, inside, poses_now, stands, turned
from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.predicates import off_floor
from bt_jax.mjx_env.skills import Released, settled_world
from bt_jax.mjx_env.surfaces import Surfaces, fixed_surfaces, outline_of, overlaps, surface_names
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Table, Target, Task
from bt_jax.tasks.support import kit_origin

__all__ = [
    "check_kits",
    "check_over_table",
    "fixed_layout",
    "free_layout",
    "kit_table",
    "kit_tables",
    "move_kit",
    "put",
]

HIGHEST = 10.0  # longest edges over a table: what is higher is out of reach
LEAST_TURN = 0.05  # degrees: what lies turned by less starts as it was made


def put(task: Task, physics: Physics, world: World, name: str, position: Point, turn: float | None = None) -> World:
    """Return the world (a batch of one, NumPy) after a person has put an object down, turned by `turn` degrees or else as it
    lies, and everything rests again.

    Raise UserError if the object is in the gripper, off the tables, inside something, or does not stay.
    """
    thing = task.thing(name)
    index = task.object_names.index(name)
    if world.held[0] == index:
        raise UserError(f"{name} is in the gripper; wait until the robot has put it down")
    now = poses_now(task, world)
    pose = turned(position, (heading(now[name]) if stands(now[name]) else 0.0) if turn is None else turn)
    check_over_table(task, name, pose)
    for other, place in now.items():
        if other != name and inside(task, name, pose, other, place):
            raise UserError(f"{name} would be inside {other}; put it beside or on top of it")
    check_kits(task, world, name, pose)
    poses = world.poses.copy()
    poses[0, index] = pose
    present = (np.arange(len(task.objects)) != world.held[0])[None]
    # Everything settles, since what had stood on the object falls somewhere else than where it is now.
    settled = physics.settle(world.kits, poses, present)
    if not np.asarray(settled.ok)[0]:
        raise UserError(f"the simulation diverged with {name} there; put it elsewhere")
    released = Released(dataclasses.replace(world, poses=poses), poses, present, np.array([-1], np.int32))
    after = settled_world(task, released, np.asarray(settled.poses))
    lost = off_floor(world, task)[0] & ~off_floor(after, task)[0]
    if lost.any():
        fallen = task.object_names[int(np.flatnonzero(lost)[0])]
        raise UserError(f"{fallen} would fall off the table; put {name} further in")
    moved = np.linalg.norm(after.poses[0, index, :2] - pose[:2])
    if moved > min(thing.size[:2]) / 2:
        raise UserError(f"{name} would not stay there, it slides off; put its middle over something that carries it")
    if not thing.is_cube and not stands(np.asarray(after.poses[0, index], float)):
        raise UserError(f"{name} would not stand there, it topples over; put it on something level")
    return after


def kit_table(task: Task, world: World) -> str:
    """Return the name of the table on which the kits stand that a person may move."""
    origin = world.kits[0, _movable(task)[0]] if _movable(task) else world.kits[0, 0]
    away = [np.linalg.norm(np.subtract(origin[:2], table.position[:2])) for table in task.tables]
    return task.tables[int(np.argmin(away))].name


def kit_tables(task: Task) -> list[str]:
    """Return the names of the tables on which these kits may stand; none where every kit has a table of its own."""
    taken = {kit.table for kit in task.kits}
    return [table.name for table in task.tables if table.name not in taken] if _movable(task) else []


def move_kit(task: Task, world: World, table: str) -> World:
    """Return the world in which these kits, with their content, have changed places with what is on another table."""
    names = [each.name for each in task.tables]
    here, there = names.index(kit_table(task, world)), names.index(table)
    step = np.subtract(task.tables[there].position, task.tables[here].position).astype(np.float32)
    first = task.kit_names[_movable(task)[0]]
    step[2] = kit_origin(task, task.tables[there], first)[2] - kit_origin(task, task.tables[here], first)[2]
    poses, kits = world.poses.copy(), world.kits.copy()
    for origin, direction in ((here, 1), (there, -1)):
        on = [_over(task.tables[origin], pose[:2]) for pose in world.poses[0]]
        poses[0, on, :3] += direction * step
    kits[0, _movable(task)] += step
    after = dataclasses.replace(world, kits=kits, poses=poses)
    return dataclasses.replace(after, reached=subgoals_by_sight(task, after))


def _movable(task: Task) -> list[int]:
    """Return the numbers of the kits without a table of their own."""
    return [number for number, kit in enumerate(task.kits) if not kit.table]


def fixed_layout(task: Task, world: World) -> Task:
    """Return the task that always starts as the world is now. Raise UserError if an object is held or tilted."""
    if world.held[0] >= 0:
        raise UserError(f"{task.object_names[int(world.held[0])]} is in the gripper; put it down first")
    places = []
    for name, pose in poses_now(task, world).items():
        if not stands(pose):
            raise UserError(f"{name} does not stand upright; drag it to a level place first")
        x, y, z = (round(float(value), 4) + 0.0 for value in pose[:3] - task.robot_position)
        places.append(Target(name, (x, y, z), task.robot_frame, _start_turn(task, name, pose)))
    layout = dataclasses.replace(task.layout, kit=kit_table(task, world), stack=(), fixed=tuple(places))
    return dataclasses.replace(task, layout=layout)


def _start_turn(task: Task, name: str, pose: Pose) -> float | None:
    """Return how an object lies, degrees, None if it lies as it was made or looks as if."""
    period = task.thing(name).symmetry
    turn = round(heading(pose) % period, 1) % period if period else 0.0
    return None if min(turn, period - turn) < LEAST_TURN else turn


def free_layout(task: Task, base: Task) -> Task:
    """Return the task with objects that start as in another task, at random places."""
    return dataclasses.replace(task, layout=dataclasses.replace(base.layout, fixed=()))


def _over(table: Table, point: Float[np.ndarray, "2"]) -> bool:
    return bool(np.all(np.abs(np.subtract(point, table.position[:2])) <= np.array(table.size[:2]) / 2))


def check_over_table(task: Task, name: str, pose: Pose) -> None:
    """Raise UserError if an object would not be over a table, in reach."""
    if not np.all(np.isfinite(pose)):
        raise UserError(f"the place for {name} is not a number; give x, y and z")
    tables = [table for table in task.tables if _over(table, pose[:2])]
    if not tables:
        raise UserError(f"there is no table there, out of reach for {name}; put it over one of the tables")
    half = half_of(task.thing(name), pose)[2]
    if pose[2] - half < tables[0].top - 2 * TOUCHING * half:
        raise UserError(f"{name} would be inside {tables[0].name}; put it higher")
    if pose[2] > tables[0].top + HIGHEST * max(thing.edge for thing in task.objects):
        raise UserError(f"{name} would be too high, out of reach; put it lower")


def check_kits(task: Task, world: World, name: str, pose: Pose) -> None:
    """Raise UserError if an object would be inside the plate or a wall of a kit."""
    half, fixed = half_of(task.thing(name), pose), fixed_surfaces(task, world.kits)
    first = 1 + len(task.tables)
    parts = Surfaces(fixed.centre[:, first:], fixed.half[:, first:], fixed.top[:, first:])
    outline = outline_of(task, np.asarray(pose[None, 3:], np.float32), np.array([task.object_names.index(name)]))
    under = overlaps(parts, np.asarray(pose[None, :2], np.float32), np.asarray(half[None, :2], np.float32), outline)[0]
    hit = under & (parts.top[0] > pose[2] - half[2] + 2 * TOUCHING * half[2])
    if hit.any():
        kit = surface_names(task)[first + int(np.flatnonzero(hit)[0])]
        called = "the kit" if len(task.kits) == 1 else kit
        raise UserError(f"{name} would be inside {called}'s wall or floor; put it further in or higher")
