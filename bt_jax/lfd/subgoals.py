"""What a demonstration changes in the scene, as a configuration that is worth reaching."""

from __future__ import annotations

from collections.abc import Sequence

from bt_jax.behaviors import NOTHING, OPEN, Behavior, subgoal_conditions
from bt_jax.behaviors.geometry import is_at, is_reachable
from bt_jax.lfd.contact import is_under
from bt_jax.lfd.demonstration import Action, Demonstrations
from bt_jax.tasks import Subgoal, Task

__all__ = ["derive_subgoal"]


def derive_subgoal(name: str, demonstrations: Demonstrations, goal: Sequence[Behavior], task: Task) -> Subgoal:
    """Return the configuration that all demonstrations reach, as general as they allow.

    If it is one of the task's subgoals, it is that one, with its own name. If they free boxes on which others stood, it is
    that those are clear: where the others were put does not matter. Otherwise it is the goal, the places of what was moved.
    """
    for subgoal in task.subgoals:
        meaning = subgoal_conditions(task)[subgoal.name]
        if all(_all_hold(meaning, one.actions[-1], task) and not _all_hold(meaning, one.actions[0], task)
               for one in demonstrations):  # fmt: skip
            return subgoal
    freed = [
        Behavior("clear", (box,))
        for box in task.object_names
        if all(is_under(box, one.actions[0], task) and not is_under(box, one.actions[-1], task)
               for one in demonstrations)
    ]  # fmt: skip
    conditions = [
        *(freed or [condition for condition in goal if condition.name == "at"]),
        Behavior("holding", (NOTHING,)),
    ]
    return Subgoal(name, tuple(map(str, conditions)))


def _all_hold(conditions: Sequence[Behavior], action: Action, task: Task) -> bool:
    """Return whether conditions hold before a pick, or after a place."""
    return all(_holds(condition, action, task) for condition in conditions)


def _holds(condition: Behavior, action: Action, task: Task) -> bool:
    """Return whether a condition holds; of a part, for any of its instances."""
    name = condition.object or ""
    return any(_holds_for(one, condition, action, task) for one in task.instances.get(name, (name,)))


def _holds_for(name: str, condition: Behavior, action: Action, task: Task) -> bool:
    match condition.name:
        case "at":
            thing, pose = task.thing(name), action.pose(name, task.robot_frame)
            frame = action.pose(condition.frame or "", task.robot_frame)
            place = condition.position or (0.0, 0.0, 0.0)
            return is_at(thing, pose, frame, place, turn=condition.turn, episode=task.episode)
        case "holding":
            return name == NOTHING
        case "gripper":
            return condition.args[0] == OPEN
        case "reachable":
            lowest = min(table.top for table in task.tables) - task.robot_position[2]
            return is_reachable(task.thing(name), float(action.origin(name, task.robot_frame)[2]), lowest)
        case "clear":
            return not is_under(name, action, task)
    raise ValueError(f"{condition} is no condition of the scene")
