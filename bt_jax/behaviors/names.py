"""Whether what a leaf names exists in a task, and what the task's subgoals mean."""

from __future__ import annotations

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.notation import parse_behavior
from bt_jax.behaviors.symbols import NOTHING, Behavior, Tree
from bt_jax.tasks import Task

__all__ = ["check_names", "subgoal_conditions"]


def subgoal_conditions(task: Task, *, source: str | None = None) -> dict[str, tuple[Behavior, ...]]:
    """Return what each subgoal of a task means, by name. Raise UserError, naming `source` (default: the task) and the key,
    if it is not made of conditions of the scene."""
    meanings = {}
    for i, subgoal in enumerate(task.subgoals):
        found: dict[Behavior, None] = {}
        for j, text in enumerate(subgoal.conditions):
            try:
                found |= dict.fromkeys(_condition(text.replace("{box}", name), task) for name in task.object_names)
            except UserError as error:
                where = f"{source or f'task {task.name}'}, key subgoals[{i}].conditions[{j}]"
                raise UserError(f"{where}: {error}") from error
        meanings[subgoal.name] = tuple(found)
    return meanings


def _condition(text: str, task: Task) -> Behavior:
    """Return a condition of the scene. Raise UserError if the text is none."""
    condition = parse_behavior(text)
    if condition.kind != Kind.CONDITION or condition.name == "reached":
        raise UserError(
            f"{condition} is not a condition of the scene; use at, holding, gripper, reachable, clear or is_seen"
        )
    check_names(condition, task)
    return condition


def check_names(leaf: Behavior, task: Task) -> None:
    """Raise UserError if a leaf names an object, frame or subgoal that the task does not have."""
    if leaf.body is not None:
        _check_tree(leaf.body, task)
    if leaf.object is not None and leaf.object not in (*task.instances, *([NOTHING] if leaf.name == "holding" else [])):
        objects = [*task.kinds, *([NOTHING] if leaf.name == "holding" else [])]
        raise UserError(f"{leaf}: task {task.name} has no object '{leaf.object}'; use one of {', '.join(objects)}")
    if leaf.frame is not None and (leaf.frame not in task.frames or leaf.frame == leaf.object):
        frames = [frame for frame in task.frames if frame != leaf.object and not _is_instance(task, frame)]
        raise UserError(f"{leaf}: task {task.name} has no frame '{leaf.frame}'; use one of {', '.join(frames)}")
    if leaf.name == "reached" and leaf.args[0] not in [subgoal.name for subgoal in task.subgoals]:
        raise UserError(f"{leaf}: task {task.name} has no such subgoal; add it under subgoals")


def _is_instance(task: Task, name: str) -> bool:
    return name in task.object_names and bool(task.thing(name).part)


def _check_tree(tree: Tree, task: Task) -> None:
    if isinstance(tree, Behavior):
        check_names(tree, task)
        return
    for child in tree.children:
        _check_tree(child, task)
