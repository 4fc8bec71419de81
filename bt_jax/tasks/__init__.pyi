from bt_jax.tasks.changes import with_faults, with_goal_of, with_subgoal, with_target, with_targets
from bt_jax.tasks.checks import problems
from bt_jax.tasks.faults import Faults, load_faults
from bt_jax.tasks.files import load_task, parse_task, task_from_dict, task_names, task_of_folder
from bt_jax.tasks.refusals import Problem
from bt_jax.tasks.robot import Base, Robot
from bt_jax.tasks.task import Episode, GeneSettings, Layout, Subgoal, Target, Task, Weights
from bt_jax.tasks.things import Kit, Object, Slot, Table

__all__ = [
    "Base",
    "Episode",
    "Faults",
    "GeneSettings",
    "Kit",
    "Layout",
    "Object",
    "Problem",
    "Robot",
    "Slot",
    "Subgoal",
    "Table",
    "Target",
    "Task",
    "Weights",
    "load_faults",
    "load_task",
    "parse_task",
    "problems",
    "task_from_dict",
    "task_names",
    "task_of_folder",
    "with_faults",
    "with_goal_of",
    "with_subgoal",
    "with_target",
    "with_targets",
]
