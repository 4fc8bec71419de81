"""Tasks made from other tasks; what comes out is checked like a task from a file."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from bt_jax._util.errors import UserError
from bt_jax.tasks.checks import check
from bt_jax.tasks.task import Subgoal, Target, Task

__all__ = ["with_goal_of", "with_subgoal", "with_targets"]


def with_targets(task: Task, targets: Sequence[Target], *, source: str) -> Task:
    """Return the task with more targets, each in place of one that the same object has; `source` is named in errors."""
    kept = {target.object: target for target in (*task.targets, *targets)}
    changed = dataclasses.replace(task, targets=tuple(kept.values()))
    check(changed, source)
    return changed


def with_goal_of(task: Task, other: Task) -> Task:
    """Return the task with the targets and the starts of another. Raise UserError unless both have the same boxes and
    frames."""
    if (task.boxes, task.frames) != (other.boxes, other.frames):
        raise UserError(f"{other.name} has other boxes or frames than {task.name}; evolve a new tree for it")
    return dataclasses.replace(task, targets=other.targets, layout=other.layout)


def with_subgoal(task: Task, subgoal: Subgoal, *, source: str) -> Task:
    """Return the task with one more subgoal, unless it has that already; `source` is named in errors."""
    if subgoal in task.subgoals:
        return task
    if subgoal.name in [other.name for other in task.subgoals]:
        raise UserError(f"{source}: task {task.name} has another subgoal '{subgoal.name}'; rename the new one")
    changed = dataclasses.replace(task, subgoals=(*task.subgoals, subgoal))
    check(changed, source)
    return changed
