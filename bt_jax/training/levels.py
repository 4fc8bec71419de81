"""The levels at which a training simulates: what lets boxes fall."""

from __future__ import annotations

from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.tasks import Task
from bt_jax.training.settings import Settings

__all__ = ["make_level"]


def make_level(task: Task, settings: Settings) -> Physics:
    """Return what lets boxes fall at the chosen level."""
    if settings.level == "kinematic":
        return Kinematic(task)
    return make_physics(task, settings.backend, implementation=settings.implementation)
