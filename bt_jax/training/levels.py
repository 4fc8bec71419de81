"""The levels at which a training simulates: what lets boxes fall."""

from __future__ import annotations

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Physics, SettleFn
from bt_jax.tasks import Task
from bt_jax.training.settings import Settings

__all__ = ["make_level", "make_settle"]


def make_level(task: Task, settings: Settings) -> Physics:
    """Return what lets boxes fall at the chosen level."""
    if settings.level == "kinematic":
        return Kinematic(task)
    return make_physics(task, settings.backend, implementation=settings.implementation)


def make_settle(task: Task, level: Physics, settings: Settings) -> SettleFn:
    """Return the same as a pure JAX function. Raise UserError for the C engine, which has none."""
    if level.name == "kinematic":
        return Kinematic(task).settle
    if level.name == "mujoco":
        raise UserError("the rollout evaluator cannot call the C engine; use --backend mjx, or --evaluator table")
    from bt_jax.mjx_env.physics.mjx import settle_fn  # heavy: MJX is not needed on a CPU

    return settle_fn(task, implementation=settings.implementation)
