from bt_jax.lfd.clustering import Candidate
from bt_jax.lfd.corrections import Corrections
from bt_jax.lfd.demonstration import Action, Demonstration, Demonstrations, Frames, Instance, Pose, RecordedTask
from bt_jax.lfd.demonstration_folder import DemonstrationFolder
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson, learn
from bt_jax.lfd.planner import plan, plan_task
from bt_jax.lfd.proposing import Proposal, propose
from bt_jax.lfd.questions import Answer, Question, open_questions

__all__ = [
    "Action",
    "Answer",
    "Candidate",
    "Corrections",
    "Demonstration",
    "DemonstrationFolder",
    "Demonstrations",
    "Frames",
    "Inference",
    "Instance",
    "Lesson",
    "Pose",
    "Proposal",
    "Question",
    "RecordedTask",
    "learn",
    "open_questions",
    "plan",
    "plan_task",
    "propose",
]
