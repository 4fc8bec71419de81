from bt_jax.tasks.changes import with_goal_of, with_subgoal, with_targets
from bt_jax.tasks.files import load_task, task_from_dict, task_names, task_of_folder
from bt_jax.tasks.task import Box, Episode, GeneSettings, Kit, Layout, Subgoal, Table, Target, Task, Weights

__all__ = [
    "Box",
    "Episode",
    "GeneSettings",
    "Kit",
    "Layout",
    "Subgoal",
    "Table",
    "Target",
    "Task",
    "Weights",
    "load_task",
    "task_from_dict",
    "task_names",
    "task_of_folder",
    "with_goal_of",
    "with_subgoal",
    "with_targets",
]
