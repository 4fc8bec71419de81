"""The scene in words, for people who do not see it: where each object is, and where it should be."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from bt_jax.app.plain_words import Words
from bt_jax.app.state.extents import carriers, heading, poses_now
from bt_jax.app.units import length
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.predicates import is_upright
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Task

__all__ = ["THERE", "ObjectWords", "gripper_words", "object_words", "target_state", "target_words"]

THERE = "there"


@dataclasses.dataclass(frozen=True)
class ObjectWords:
    """A sentence that says where an object is; `support` is what it is on or in, which changes less often than the place."""

    sentence: str
    support: str


def object_words(task: Task, world: World) -> dict[str, ObjectWords]:
    """Say where each object is in `world`, a batch of one (NumPy)."""
    words, poses, upright = Words(task), poses_now(task, world), is_upright(world, task)[0]
    where = dict(zip(task.frames, np.asarray(frames(world, task)[0, :, :3], float), strict=True))
    found = {}
    for index, (name, pose) in enumerate(poses.items()):
        if world.held[0] == index:
            found[name] = ObjectWords(f"{name} is in the gripper", "the gripper")
            continue
        others = {other: place for other, place in poses.items() if other != name}
        frame = next(iter(carriers(task, world, name, pose, others)), task.robot_frame)
        x, y, z = (float(value) for value in where[name] - where[frame])
        support = _table(task, where[name]) if frame == task.robot_frame else frame
        lying = _lying(task, name, pose) if upright[index] else ", toppled over"
        found[name] = ObjectWords(f"{name} is {words.place(name, (x, y, z), frame)}{lying}", support)
    return found


def target_words(task: Task, world: World) -> list[str]:
    """Say where objects should be, and how far they are from there."""
    words = Words(task)
    return [
        f"{words.named(target.object)} should be {words.target(target)}: it is {state}"
        for target, state in zip(task.targets, target_state(task, world), strict=True)
    ]


def target_state(task: Task, world: World) -> list[str]:
    """Say of each target how far its object, or the instance that is meant for it, is from there: "120 mm away"."""
    misses, said, held = target_misses(task, world), [], int(world.held[0])
    hangs = {task.objects[held].name, task.objects[held].part} if held >= 0 else set()
    for target, away, turn, met in zip(task.targets, misses.distance[0], misses.turn[0], misses.met[0], strict=True):
        if met:
            said.append(THERE)
        elif target.object in hangs and away < task.episode.tolerance:
            said.append("there, but still in the gripper")
        elif away >= task.episode.tolerance:
            said.append(f"{length(away)} away")
        elif turn >= math.radians(task.episode.turn_tolerance):
            said.append(f"turned by {math.degrees(turn):.0f} degrees too far")
        else:
            said.append("there, but not upright")
    return said


def gripper_words(task: Task, world: World) -> str:
    """Say what is in the gripper."""
    held = int(world.held[0])
    return f"the gripper holds {task.object_names[held]}" if held >= 0 else "the gripper is empty"


def _lying(task: Task, name: str, pose: np.ndarray) -> str:
    """Say how an object lies that stands upright, unless it looks as if it lay as it was made."""
    period = task.thing(name).symmetry
    turn = 0 if period != 180 else round(heading(pose)) % period
    return f", turned by {turn:g} degrees" if turn else ""


def _table(task: Task, point: np.ndarray) -> str:
    nearest = min(task.tables, key=lambda table: float(np.linalg.norm(np.subtract(table.position[:2], point[:2]))))
    return nearest.name
