"""Where everything stands at the start while a person builds a kit: what stays keeps its place, the rest gets a free one."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.app.state.arrangement import check_kits, check_over_table, kit_table
from bt_jax.app.state.extents import Point, Pose, carriers, half_of, inside, poses_now, turned
from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.driving import start as standing
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Object, Table, Task, problems
from bt_jax.tasks.support import kit_origin

__all__ = ["carried", "first_start"]

STEPS = 12  # between the middle of a table and its edge, in the search for a free place


def first_start(task: Task) -> World:
    """Return the first start that is drawn (a batch of one, NumPy) or, if the task leaves no room to draw any, one in which
    everything stands somewhere."""
    if all(problem.key.startswith(("targets", "episode", "faults")) for problem in problems(task)):
        return sample_layouts(task, 0, 1)
    names = [table.name for table in task.tables]
    table = task.tables[names.index(task.layout.kit) if task.layout.kit in names else len(names) // 2]
    return _start(task, table, {})


def carried(before: Task, start: World, after: Task) -> World:
    """Return the start of a task that was made from another by a change of its objects and kits. An object stays where it
    stands, on a kit that has moved or an object that has grown, too; a new one gets a free place, and so does one that would
    be inside something.

    What has another name is known by its number among the objects or kits.
    """
    own = next((one for one in after.tables if one.name == kit_table(before, start)), after.tables[0])
    kits, now = start.kits[0], poses_now(before, start)
    same = _same(before.object_names, after.object_names)
    found: dict[str, tuple[Pose, str]] = {}
    for new, old in same.items():
        pose, thing, grown = now[old].copy(), before.thing(old), after.thing(new)
        pose[2] += (grown.height - thing.height) / 2
        others = {name: place for name, place in now.items() if name != old}
        under = next((one for one in carriers(before, start, old, now[old], others) if one in others), "")
        for name, before_name in _same(before.kit_names, after.kit_names).items():
            origin = np.asarray(kits[before.kit_names.index(before_name)], float)
            kit = before.kits[before.kit_names.index(before_name)]
            if np.all(np.abs(pose[:2] - origin[:2]) < kit.half) and abs(now[old][2] - origin[2]) < 1.0:
                pose[:3] += np.array(kit_origin(after, own, name)) - origin
                break
        found[new] = pose, next((name for name, one in same.items() if one == under), "")
    return _start(after, own, found)


def _same(before: tuple[str, ...], after: tuple[str, ...]) -> dict[str, str]:
    """Return what things were called before, by what they are called now."""
    known = {name: name for name in after if name in before}
    for old, new in zip(before, after, strict=False):
        if old not in after and new not in before:
            known[new] = old
    return known


def _start(task: Task, table: Table, known: Mapping[str, tuple[Pose, str]]) -> World:
    """Return the start with the kits that have no table of their own on a table; `known` are poses, and what is under."""
    kits = np.array([[kit_origin(task, table, name) for name in task.kit_names]], np.float32)
    world = World(
        kits=kits,
        poses=np.tile(np.array([0, 0, -1e3, 1, 0, 0, 0], np.float32), (1, len(task.objects), 1)),
        held=np.array([-1], np.int8),
        gripper_open=np.array([True]),
        reached=np.zeros((1, len(task.subgoals)), bool),
        unseen=None if task.faults is None else np.zeros((1, len(task.objects)), bool),
        base=standing(task, 1),
    )
    placed: dict[str, Pose] = {}
    for name in sorted(known, key=lambda one: known[one][0][2]):
        pose, under = known[name]
        if under in placed:
            top = placed[under][2] + half_of(task.thing(under), placed[under])[2]
            pose[2] = top + half_of(task.thing(name), pose)[2]
        if _stays(task, world, name, pose, placed):
            placed[name] = pose
    for thing in task.objects:
        if thing.name not in placed:
            placed[thing.name] = _free_place(task, world, thing, placed)
    poses = np.array([[placed[name] for name in task.object_names]], np.float32)
    world = dataclasses.replace(world, poses=poses)
    return dataclasses.replace(world, reached=subgoals_by_sight(task, world))


def _stays(task: Task, world: World, name: str, pose: Pose, placed: Mapping[str, Pose]) -> bool:
    """Return whether an object can stand there, free of the kits and of what is placed."""
    try:
        check_over_table(task, name, pose)
        check_kits(task, world, name, pose)
    except UserError:
        return False
    return not any(inside(task, name, pose, other, place) for other, place in placed.items())


def _free_place(task: Task, world: World, thing: Object, placed: Mapping[str, Pose]) -> Pose:
    """Return the place nearest to the middle of a table where an object is free of everything, on a table without kits if
    one has room; on top of everything in the middle of one if there is no room at all."""
    origins = np.asarray(world.kits[0], float)

    def has_kit(table: Table) -> bool:
        return any(np.all(np.abs(origin[:2] - table.position[:2]) < np.array(table.size[:2]) / 2) for origin in origins)

    tables = sorted(task.tables, key=lambda table: (has_kit(table), math.hypot(*table.position[:2])))
    for table in tables:
        for point in _spots(table, thing):
            if _is_free(task, origins, thing, point, placed):
                return turned(point, 0.0)
    top = max((pose[2] + half_of(task.thing(name), pose)[2] for name, pose in placed.items()), default=tables[0].top)
    return turned(np.array([*tables[0].position[:2], max(top, tables[0].top) + thing.height / 2]), 0.0)


def _spots(table: Table, thing: Object) -> Iterator[Point]:
    """Yield places on a table, those near its middle first."""
    room = np.array(table.size[:2]) / 2 - thing.reach
    if min(room) < 0:
        return
    steps = np.arange(-STEPS, STEPS + 1) / STEPS
    spots = [np.array([x, y]) * room for y in steps for x in steps]
    for spot in sorted(spots, key=lambda one: float(np.round(np.hypot(*one), 6))):
        yield np.array([*(spot + table.position[:2]), table.top + thing.height / 2])


def _is_free(task: Task, origins: np.ndarray, thing: Object, point: Point, placed: Mapping[str, Pose]) -> bool:
    """Return whether fingers have room around an object there."""
    least = thing.reach + 2 * task.finger_room
    for name, pose in placed.items():
        if math.dist(point[:2], pose[:2]) < least + task.thing(name).radius:
            return False
    return not any(
        np.all(np.abs(point[:2] - origin[:2]) < np.array(kit.half) + thing.reach)
        for kit, origin in zip(task.kits, origins, strict=True)
    )
