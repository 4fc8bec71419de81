"""What a YuMi may do in a task's cell."""

from __future__ import annotations

from bt_jax.deploy import yumi
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.planning.clearance import SafetyClearance
from bt_jax.tasks import Task

__all__ = ["yumi_rules"]


def yumi_rules(task: Task, *, override: float = float("inf")) -> Rules:
    """The rules of a cell; `override` is the largest joint speed, rad/s."""
    return Rules(
        lower=tuple(map(float, yumi.LOWER)),
        upper=tuple(map(float, yumi.UPPER)),
        speed=tuple(map(float, yumi.SPEED)),
        override=override,
        points=yumi.points,
        clearance_of=SafetyClearance(task),
    )
