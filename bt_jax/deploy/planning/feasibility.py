"""Whether a task is one for a robot: tables where its arms work, objects that its grippers take and its arms may carry."""

from __future__ import annotations

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.planning.grasps import grip_widths
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["check_scale", "load_share"]

SLACK = 0.001  # m


def check_scale(robot: RobotModel, task: Task) -> None:
    """Raise UserError where an object is wider than the grippers open, or the middle of a table's top is outside the
    workspace or farther from every arm's base than the arm is long."""
    remedy = "choose a task at the robot's scale" + (f", such as {robot.example}" if robot.example else "")
    opening = max(arm.gripper.opening for arm in robot.arms)
    for thing in task.objects:
        width = min(thing.size[:2])
        if not grip_widths(thing, opening):
            raise UserError(
                f"{thing.name} of task {task.name} is {1000 * width:.0f} mm wide, and the grippers of {robot.name} open "
                f"{1000 * opening:.0f} mm; {remedy}"
            )
    lowest, highest = np.array(robot.workspace)
    for table in task.tables:
        top = np.array([*table.position[:2], table.top]) - task.robot_position
        near = any(np.linalg.norm(top - arm.base) <= arm.length for arm in robot.arms)
        if not (near and np.all(top >= lowest - SLACK) and np.all(top <= highest + SLACK)):
            raise UserError(
                f"{table.name} of task {task.name} is out of the reach of {robot.name}: its top is at "
                f"({', '.join(f'{value:g}' for value in top)}) m in the robot's base frame; {remedy}"
            )


def load_share(robot: RobotModel, task: Task, gripper_mass: float | None = None) -> float:
    """Return the largest share of its payload that an arm carries, with its gripper. Raise UserError where it is too much.

    `gripper_mass` is that of a gripper with its fingers, kg, where it differs from the model's.
    """
    worst = 0.0
    for arm in robot.arms:
        gripper = arm.gripper.total_mass if gripper_mass is None else gripper_mass
        for box in task.objects:
            mass = gripper + box.mass
            if not (gripper >= 0 and mass <= arm.payload):
                raise UserError(
                    f"{box.name} ({1000 * box.mass:.0f} g) and the gripper ({1000 * gripper:.0f} g) are more than the "
                    f"{1000 * arm.payload:.0f} g that the {arm.name} arm may carry; use lighter boxes and give their "
                    "density in the task, or give the mass of the gripper with --gripper-mass"
                )
            worst = max(worst, mass / arm.payload)
    return worst
