"""Learning from demonstration: frames, goals and orders inferred from a few demonstrations, and a tree planned from them."""

from bt_jax.lfd.demonstration import Action, Demonstration, Demonstrations, Frames, Moment, Pose
from bt_jax.lfd.demonstration_folder import DemonstrationFolder
from bt_jax.lfd.learning import Lesson, learn
from bt_jax.lfd.planner import plan, plan_task

__all__ = [
    "Action",
    "Demonstration",
    "DemonstrationFolder",
    "Demonstrations",
    "Frames",
    "Lesson",
    "Moment",
    "Pose",
    "learn",
    "plan",
    "plan_task",
]
