from bt_jax.lfd.clustering import Candidate
from bt_jax.lfd.demonstration import Action, Demonstration, Demonstrations, Frames, Instance, Pose, RecordedTask
from bt_jax.lfd.demonstration_folder import DemonstrationFolder
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson, learn
from bt_jax.lfd.planner import plan, plan_task
from bt_jax.lfd.questions import Question

__all__ = [
    "Action",
    "Candidate",
    "Demonstration",
    "DemonstrationFolder",
    "Demonstrations",
    "Frames",
    "Inference",
    "Instance",
    "Lesson",
    "Pose",
    "Question",
    "RecordedTask",
    "learn",
    "plan",
    "plan_task",
]
