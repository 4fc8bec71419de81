"""What happens between two ticks: an object gets out of sight, and a person moves one, takes one away or brings one back.

Functions take NumPy or JAX arrays alike. Events are numbers, 0 for nothing, that mean the same in every state. Nothing
happens where a person would do nothing: to an object that the gripper holds, or that another one stands on.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools

import numpy as np
from jaxtyping import Bool, Float32, Int32

from bt_jax.mjx_env.conditions import subgoals_by_sight
from bt_jax.mjx_env.faults.variants import bit
from bt_jax.mjx_env.predicates import is_clear
from bt_jax.mjx_env.world import Array, World, headings, namespace, snap
from bt_jax.tasks import Task

__all__ = [
    "ALL_SEEN",
    "SPOTS",
    "brings",
    "hides",
    "is_away",
    "moves",
    "num_person_events",
    "num_sight_events",
    "person_acts",
    "person_bits",
    "sight_bits",
    "sight_changes",
    "takes",
]

SPOTS = 8  # where a person may begin to look for a free place
ROW = 5  # places in a row of a table
AWAY = 2.0  # how far beside the tables lies what a person has taken away, metres
ALL_SEEN = 1  # the event of sight after which everything is in sight


def hides(thing: int | np.ndarray) -> int | np.ndarray:
    """Return the event of sight after which one object, given by its index, is out of sight, and no other."""
    return ALL_SEEN + 1 + thing


def takes(task: Task, thing: int | np.ndarray) -> int | np.ndarray:
    """Return the event that a person takes an object away."""
    return 1 + thing


def moves(task: Task, thing: int | np.ndarray, spot: int | np.ndarray) -> int | np.ndarray:
    """Return the event that a person puts an object elsewhere: at the first free place from one of SPOTS on."""
    return 1 + len(task.objects) + SPOTS * thing + spot


def brings(task: Task, thing: int | np.ndarray, spot: int | np.ndarray) -> int | np.ndarray:
    """Return the event that a person brings an object back that was taken away."""
    return moves(task, thing, spot) + SPOTS * len(task.objects)


def num_sight_events(task: Task) -> int:
    """Return one more than the largest event of sight."""
    return ALL_SEEN + 1 + len(task.objects)


def num_person_events(task: Task) -> int:
    """Return one more than the largest event of a person."""
    return 1 + len(task.objects) * (1 + 2 * SPOTS)


def person_bits(task: Task) -> Int32[np.ndarray, " events"]:
    """Return the fault to which each event of a person belongs, as a bit (see `variants.bit`)."""
    objects = len(task.objects)
    counts = [1, objects, SPOTS * objects, SPOTS * objects]
    return np.repeat(np.array([0, bit("take"), bit("move"), bit("take")], np.int32), counts)


def sight_bits(task: Task) -> Int32[np.ndarray, " events"]:
    """Return the fault to which each event of sight belongs, as a bit; that everything is in sight again is none."""
    return np.repeat(np.array([0, bit("hide")], np.int32), [ALL_SEEN + 1, len(task.objects)])


def is_away(world: World, task: Task) -> Bool[Array, "S B"]:
    """Return which objects a person has taken away."""
    return world.poses[..., 0] < np.float32(_edge(task) - AWAY / 2)


def sight_changes(world: World, task: Task, event: Int32[Array, " S"]) -> World:
    """Return the states after an event of sight. What was taken away stays out of sight."""
    assert world.unseen is not None
    hidden = event[:, None] - hides(0) == np.arange(len(task.objects), dtype=np.int32)[None]
    unseen = namespace(event).where(event[:, None] > 0, hidden | is_away(world, task), world.unseen)
    return _with_subgoals(task, dataclasses.replace(world, unseen=unseen))


def person_acts(world: World, task: Task, event: Int32[Array, " S"]) -> World:
    """Return the states after an event of a person: the object stands upright, turned as before, at its new place."""
    assert world.unseen is not None
    xp, count = namespace(event), len(task.objects)
    taken, rest = (event > 0) & (event <= count), event - 1 - count
    brought = rest >= SPOTS * count
    within = xp.maximum(rest, 0) % (SPOTS * count)
    thing = xp.where(taken, event - 1, within // SPOTS)
    own = thing[:, None] == np.arange(count, dtype=np.int32)[None]
    away = is_away(world, task)
    free, place = _free_place(world, task, thing, within % SPOTS)
    idle = world.held[:, None] != np.arange(count, dtype=np.int8)[None]
    can = own & idle & xp.where(brought[:, None], away, ~away & is_clear(world, task))
    acts = can & (event > 0)[:, None] & (taken | free)[:, None]
    goal = xp.where(taken[:, None, None], xp.asarray(_parking(task))[None], place[:, None])
    half = np.array([[thing.height / 2 for thing in task.objects]], np.float32)
    turn = headings(world.poses[..., 3:]) / 2
    zero = xp.zeros_like(turn)
    upright = [goal[..., 0] + zero, goal[..., 1] + zero, goal[..., 2] + half, xp.cos(turn), zero, zero, xp.sin(turn)]
    poses = xp.where(acts[..., None], snap(xp.stack(upright, axis=-1)), world.poses)
    unseen = xp.where(acts, taken[:, None], world.unseen)
    return _with_subgoals(task, dataclasses.replace(world, poses=poses, unseen=unseen))


def _free_place(
    world: World, task: Task, thing: Int32[Array, " S"], spot: Int32[Array, " S"]
) -> tuple[Bool[Array, " S"], Float32[Array, "S 3"]]:
    """Return whether there is room for an object on a table without a kit, and where: the first of the places from `spot`
    on, metres in the world."""
    xp, objects = namespace(spot), np.arange(len(task.objects), dtype=np.int32)
    places = xp.asarray(_places(task))[thing]
    reach = xp.asarray(np.array([each.reach for each in task.objects], np.float32))
    apart = places[:, :, None, :2] - world.poses[:, None, :, :2]
    least = (reach[None] + reach[thing][:, None] + np.float32(task.finger_room + 0.005))[:, None]
    others = (objects[None] != thing[:, None]) & (world.held.astype(np.int32)[:, None] != objects[None])
    taken = (apart[..., 0] ** 2 + apart[..., 1] ** 2 < least**2) & others[:, None]
    clear = ~taken.any(axis=2) & ~_beside_kit(world, task)
    count = places.shape[1]
    turn = (np.arange(count, dtype=np.int32)[None] + spot[:, None] * np.int32(-(-count // SPOTS))) % np.int32(count)
    in_order = xp.take_along_axis(clear, turn, axis=1)
    found = xp.take_along_axis(turn, xp.argmax(in_order, axis=1)[:, None], axis=1)
    return in_order.any(axis=1), xp.take_along_axis(places, found[:, :, None], axis=1)[:, 0]


def _beside_kit(world: World, task: Task) -> Bool[Array, "S places"]:
    """Return which places are on a table with a kit."""
    middles = np.array([table.position[:2] for table in task.tables], np.float32)
    halves = np.array([table.size[:2] for table in task.tables], np.float32) / 2
    off = namespace(world.kits).abs(world.kits[:, None, :, :2] - middles[None, :, None])
    kit = (off < halves[None, :, None]).all(axis=-1).any(axis=-1)
    return kit[:, np.repeat(np.arange(len(task.tables)), ROW * ROW)]


@functools.lru_cache(maxsize=16)
def _places(task: Task) -> Float32[np.ndarray, "B places 3"]:
    """Return where on the tables a person puts each object, metres in the world, heights those of the tops."""
    steps = np.linspace(-1, 1, ROW)
    found = np.zeros((len(task.objects), len(task.tables) * ROW * ROW, 3), np.float32)
    for i, thing in enumerate(task.objects):
        row = 0
        for table in task.tables:
            x, y = (max(0.0, size / 2 - thing.reach) for size in table.size[:2])
            for a, b in itertools.product(steps, steps):
                found[i, row] = table.position[0] + x * a, table.position[1] + y * b, table.top
                row += 1
    return found


@functools.lru_cache(maxsize=16)
def _parking(task: Task) -> Float32[np.ndarray, "B 3"]:
    """Return where on the floor, beside the tables, each object lies that was taken away, metres in the world."""
    spacing = 4 * max(thing.reach for thing in task.objects)
    return np.array([(_edge(task) - AWAY - spacing * i, 0.0, task.floor) for i in range(len(task.objects))], np.float32)


def _edge(task: Task) -> float:
    """Return the least x of the tables, metres in the world."""
    return min(table.position[0] - table.size[0] / 2 for table in task.tables)


def _with_subgoals(task: Task, world: World) -> World:
    return dataclasses.replace(world, reached=world.reached | subgoals_by_sight(task, world))
