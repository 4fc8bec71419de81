"""Tasks made from other tasks; what comes out is checked like a task from a file."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from bt_jax._util.errors import UserError
from bt_jax._util.words import listed
from bt_jax.tasks.checks import check, problems
from bt_jax.tasks.faults import Faults
from bt_jax.tasks.task import Subgoal, Target, Task
from bt_jax.tasks.written import ticks_for

__all__ = [
    "not_taken_over",
    "with_faults",
    "with_goal_of",
    "with_subgoal",
    "with_target",
    "with_targets",
    "without_faults",
]

SCENE = ("objects", "tables", "kits", "robot_frame", "robot_position", "gripper_opening", "finger_room")
WORTH = ("episode", "weights", "subgoals", "subgoal_reward", "faults")


def with_targets(task: Task, targets: Sequence[Target], *, source: str) -> Task:
    """Return the task with more targets, each in place of the one that the same object has, or that the same part has in
    that place; `source` is named in errors."""
    kept = list(task.targets)
    for target in targets:
        index = next((i for i, other in enumerate(kept) if _replaces(task, target, other)), len(kept))
        kept[index : index + 1] = [target]
    changed = dataclasses.replace(task, targets=tuple(kept))
    check(changed, source)
    return changed


def with_target(task: Task, target: Target, *, instead_of: Target | None, source: str) -> Task:
    """Return the task with a target in place of another, or behind the others, and with the ticks that one more takes.

    `source` is named in errors. What else is wrong with the task may stay.
    """
    kept = tuple(target if other is instead_of else other for other in task.targets)
    targets = kept if instead_of is not None else (*task.targets, target)
    ticks = task.episode.max_ticks if instead_of is not None else max(task.episode.max_ticks, ticks_for(len(targets)))
    changed = dataclasses.replace(task, targets=targets, episode=dataclasses.replace(task.episode, max_ticks=ticks))
    check(changed, source, unfinished=True)
    key = f"targets[{targets.index(target)}]"
    for one in problems(changed):
        if one.key.startswith(key) and one not in problems(task):
            raise UserError(f"{source}: {one}")
    return changed


def with_goal_of(task: Task, other: Task) -> Task:
    """Return the task with the targets and the starts of another, and nothing else of it. Raise UserError unless both have
    the same scene."""
    if different := _different(task, other, SCENE):
        raise UserError(
            f"{other.name} has other values for {listed(different)} than {task.name}; evolve a new tree for it"
        )
    changed = dataclasses.replace(task, targets=other.targets, layout=other.layout)
    check(changed, other.name)
    return changed


def not_taken_over(task: Task, other: Task) -> list[str]:
    """Return the keys that decide what a tree is worth, and that `with_goal_of` leaves as they are though they differ."""
    return _different(task, other, WORTH)


def _replaces(task: Task, new: Target, old: Target) -> bool:
    """Return whether a target leaves no room for another: an object has one, and a part one in each place."""
    if new.object != old.object:
        return False
    if len(task.instances.get(new.object, ())) <= 1:
        return True
    return new.frame == old.frame and math.dist(new.position, old.position) < task.episode.tolerance


def _different(task: Task, other: Task, keys: Sequence[str]) -> list[str]:
    return [key for key in keys if getattr(task, key) != getattr(other, key)]


def with_subgoal(task: Task, subgoal: Subgoal, *, source: str) -> Task:
    """Return the task with one more subgoal, unless it has that already; `source` is named in errors."""
    if subgoal in task.subgoals:
        return task
    if subgoal.name in [other.name for other in task.subgoals]:
        raise UserError(f"{source}: task {task.name} has another subgoal '{subgoal.name}'; rename the new one")
    changed = dataclasses.replace(task, subgoals=(*task.subgoals, subgoal))
    check(changed, source)
    return changed


def with_faults(task: Task, faults: Faults, *, source: str = "faults") -> Task:
    """Return the task with faults in place of those that it has, and with the longer episodes that these take; `source` is
    named in errors."""
    episode = task.episode if task.faults is not None else task.episode.with_faults()
    changed = dataclasses.replace(task, faults=faults, episode=episode)
    check(changed, source, {f"faults.{field.name}": field.name for field in dataclasses.fields(Faults)})
    return changed


def without_faults(task: Task) -> Task:
    """Return the task with nothing that goes wrong, and with the shorter episodes that this takes."""
    if task.faults is None:
        return task
    return dataclasses.replace(task, faults=None, episode=task.episode.without_faults())
