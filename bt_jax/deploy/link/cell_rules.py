"""What a robot may do in a cell: the rules of the supervisor, from the robot's model and the task's tables."""

from __future__ import annotations

import numpy as np

from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.planning.clearance import SafetyClearance
from bt_jax.deploy.planning.feasibility import check_scale
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["cell_rules"]


def cell_rules(robot: RobotModel, task: Task, *, override: float = float("inf")) -> Rules:
    """Return what a robot may do in a task's cell; `override` is the largest joint speed, rad/s.

    Raise ValueError if its arms have different limits: the rules are the same for all. Raise UserError for a task that is
    not at the robot's scale.
    """
    check_scale(robot, task)
    arm, *others = robot.arms
    for name in ("lower", "upper", "speed", "acceleration"):
        if not all(np.array_equal(getattr(arm, name), getattr(other, name)) for other in others):
            raise ValueError(f"the arms of {robot.name} differ in their limits ({name}), which the rules cannot say")
    return Rules(
        lower=tuple(map(float, arm.lower)),
        upper=tuple(map(float, arm.upper)),
        speed=tuple(map(float, arm.speed)),
        acceleration=tuple(map(float, arm.acceleration)),
        override=override,
        lowest=robot.workspace[0],
        highest=robot.workspace[1],
        points=robot.points,
        clearance_of=SafetyClearance(robot, task),
    )
