"""The settings of the published runs, by task."""

from __future__ import annotations

from bt_jax.gp.config import GPConfig

__all__ = ["published_config"]

LONGER = {"stack3": 100, "pyramid": 100}  # generations; Table I's default of the others is 50


def published_config(task: str, *, seed: int = 0) -> GPConfig:
    """Settings with which the paper's authors evolved trees for a task of this name, Table I for any other task.

    The survivors' rule and the chains of mutations are not in the paper but in the settings published with it.
    """
    rules = {"old_share": 0.1, "chain_ratio": 1.0, "seed": seed}
    if task == "restack":
        return GPConfig(population=32, generations=200, p_add=0.1, p_delete=0.3, p_change=0.6, **rules)
    return GPConfig(generations=LONGER.get(task, 50), **rules)
