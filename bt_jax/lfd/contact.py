"""What stood on what when an action was demonstrated, from the poses that were recorded."""

from __future__ import annotations

import dataclasses

from bt_jax.behaviors.geometry import rests_on
from bt_jax.behaviors.pose import Pose
from bt_jax.lfd.demonstration import Action
from bt_jax.tasks import Task

__all__ = ["is_under", "supports"]

RELEASED = 1.5  # of the lower height: how high over what it is put on an object may be released


def supports(action: Action, thing: str, task: Task) -> tuple[str, ...]:
    """Return the frames of what an object is put on, when it is released: the objects under it, or else the kit, or else
    the robot's, in which the tables are fixed."""
    robot = task.robot_frame
    lies = action.pose(thing, robot) if thing in action.poses else Pose((0.0, 0.0, 0.0))
    here = dataclasses.replace(lies, position=tuple(action.handled(robot).tolist()))
    objects = tuple(
        name
        for name in task.object_names
        if name != thing
        and name in action.poses
        and rests_on(task.thing(thing), here, task.thing(name), action.pose(name, robot), above_most=RELEASED)
    )
    if objects:
        return objects
    for kit in task.kits:
        if kit.name in action.poses:
            x, y, z = action.handled(kit.name)
            if abs(x) < kit.half[0] and abs(y) < kit.half[1] and abs(z) < RELEASED * task.thing(thing).height:
                return (kit.name,)
    return (task.robot_frame,)


def is_under(box: str, action: Action, task: Task) -> bool:
    """Return whether another box stands on this one at the moment of an action."""
    here = task.thing(box), action.pose(box, task.robot_frame)
    return any(
        rests_on(task.thing(other), action.pose(other, task.robot_frame), *here)
        for other in task.object_names
        if other != box
    )
