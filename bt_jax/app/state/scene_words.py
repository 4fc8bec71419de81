"""The scene in words, for people who do not see it: where each box is, and where it should be."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from bt_jax.app.plain_words import Words
from bt_jax.app.state.arrangement import carriers, goals
from bt_jax.mjx_env.world import World, frames
from bt_jax.tasks import Task

__all__ = ["BoxWords", "box_words", "gripper_words", "target_words"]


@dataclasses.dataclass(frozen=True)
class BoxWords:
    """A sentence that says where a box is; `support` is what it is on or in, which changes less often than the place."""

    sentence: str
    support: str


def box_words(task: Task, world: World) -> dict[str, BoxWords]:
    """Say where each box is in `world`, a batch of one (NumPy)."""
    words = Words(task)
    where = dict(zip(task.frames, np.asarray(frames(world, task)[0, :, :3], float), strict=True))
    found = {}
    for index, name in enumerate(task.object_names):
        if world.held[0] == index:
            found[name] = BoxWords(f"{name} is in the gripper", "the gripper")
            continue
        frame = _frame(task, world, name, where)
        x, y, z = (float(value) for value in where[name] - where[frame])
        support = _table(task, where[name]) if frame == task.robot_frame else frame
        found[name] = BoxWords(f"{name} is {words.place(name, (x, y, z), frame)}", support)
    return found


def target_words(task: Task, world: World) -> list[str]:
    """Say where boxes should be, and how far they are from there."""
    words, ends = Words(task), goals(task, world)
    sentences = []
    for target in task.targets:
        name = target.object
        away = float(np.linalg.norm(ends[name] - world.poses[0, task.object_names.index(name), :3]))
        now = "it is there" if away < task.episode.tolerance else f"it is {100 * away:.0f} cm away"
        sentences.append(f"{name} should be {words.place(name, target.position, target.frame)}: {now}")
    return sentences


def gripper_words(task: Task, world: World) -> str:
    """Say what is in the gripper."""
    held = int(world.held[0])
    return f"the gripper holds {task.object_names[held]}" if held >= 0 else "the gripper is empty"


def _frame(task: Task, world: World, name: str, where: Mapping[str, Float[np.ndarray, "3"]]) -> str:
    """Return the frame in which the place of a box is said: what it stands on, or that of the robot for a table."""
    others = {box: where[box] for box in task.object_names if box != name}
    return next(iter(carriers(task, world, name, where[name], others)), task.robot_frame)


def _table(task: Task, point: Float[np.ndarray, "3"]) -> str:
    nearest = min(task.tables, key=lambda table: float(np.linalg.norm(np.subtract(table.position[:2], point[:2]))))
    return nearest.name
