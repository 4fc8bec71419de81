"""Whether what a leaf names exists in a task, and what the task's subgoals mean."""

from __future__ import annotations

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.notation import parse_behavior
from bt_jax.behaviors.symbols import NOTHING, Behavior, Tree
from bt_jax.tasks import Task

__all__ = ["check_names", "is_spot", "subgoal_conditions"]


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
    _check_drive(leaf, task)
    if leaf.name in ("reachable", "approach") and is_spot(leaf, task):
        if leaf.object not in task.frames:
            raise UserError(f"{leaf}: task {task.name} has no frame '{leaf.object}'; use one of {_frames(task)}")
    elif leaf.object is not None and leaf.object not in (
        *task.instances,
        *([NOTHING] if leaf.name == "holding" else []),
    ):
        objects = [*task.kinds, *([NOTHING] if leaf.name == "holding" else [])]
        raise UserError(f"{leaf}: task {task.name} has no object '{leaf.object}'; use one of {', '.join(objects)}")
    if leaf.frame is not None and (leaf.frame not in task.frames or leaf.frame == leaf.object):
        frames = _frames(task, without=leaf.object)
        raise UserError(f"{leaf}: task {task.name} has no frame '{leaf.frame}'; use one of {frames}")
    if leaf.name == "reached" and leaf.args[0] not in [subgoal.name for subgoal in task.subgoals]:
        raise UserError(f"{leaf}: task {task.name} has no such subgoal; add it under subgoals")


def is_spot(near: Behavior, task: Task) -> bool:
    """Return whether what `reachable` or `approach` names is a kit or a position in a frame, and no object or part."""
    return near.position is not None or near.object in task.kit_names


def _frames(task: Task, *, without: str | None = None) -> str:
    """Return the frames of a task that people may use, but for one."""
    return ", ".join(frame for frame in task.frames if frame != without and not _is_instance(task, frame))


def _check_drive(leaf: Behavior, task: Task) -> None:
    """Raise UserError if a leaf is for a robot that drives, and that of the task does not."""
    near = leaf.name == "reachable" and is_spot(leaf, task)
    if task.robot.base is None and (near or leaf.name in ("approach", "carry")):
        raise UserError(
            f"{leaf}: the robot of task {task.name} does not drive; give the task a base, for instance "
            "robot: {base: {reach: 0.9}}"
        )


def _is_instance(task: Task, name: str) -> bool:
    return name in task.object_names and bool(task.thing(name).part)


def _check_tree(tree: Tree, task: Task) -> None:
    if isinstance(tree, Behavior):
        check_names(tree, task)
        return
    for child in tree.children:
        _check_tree(child, task)
