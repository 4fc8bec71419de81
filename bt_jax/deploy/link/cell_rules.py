"""What a robot may do in a cell: the rules of the supervisor, from the robot's model and the task's tables."""

from __future__ import annotations

from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.planning.clearance import SafetyClearance
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["cell_rules"]


def cell_rules(robot: RobotModel, task: Task, *, override: float = float("inf")) -> Rules:
    """Return what a robot may do in a task's cell; `override` is the largest joint speed, rad/s."""
    arm = robot.arms[0]
    return Rules(
        lower=tuple(map(float, arm.lower)),
        upper=tuple(map(float, arm.upper)),
        speed=tuple(map(float, arm.speed)),
        acceleration=tuple(map(float, arm.acceleration)),
        override=override,
        points=robot.points,
        clearance_of=SafetyClearance(robot, task),
    )
