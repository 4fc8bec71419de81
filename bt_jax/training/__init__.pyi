from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.levels import make_level
from bt_jax.training.phases import Changes, resumed
from bt_jax.training.progress import Progress, is_alive, read_progress
from bt_jax.training.published import published_config
from bt_jax.training.result import Result, Session, Test
from bt_jax.training.run import Listener, TrainingRun
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training, evolve

__all__ = [
    "Changes",
    "Checkpoint",
    "Listener",
    "Progress",
    "Result",
    "RunConfig",
    "RunFolder",
    "Session",
    "Settings",
    "Test",
    "Training",
    "TrainingRun",
    "evolve",
    "is_alive",
    "make_level",
    "published_config",
    "read_progress",
    "resumed",
]
