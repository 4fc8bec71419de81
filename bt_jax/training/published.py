"""The settings of the published runs, by task."""

from __future__ import annotations

import dataclasses

from bt_jax.gp.config import GPConfig

__all__ = ["published_config"]

LONGER = {"stack3": 100, "pyramid": 100}  # generations; Table I's default of the others is 50


def published_config(task: str, *, seed: int = 0) -> GPConfig:
    """Return the settings with which the paper's authors evolved trees for a task of this name, Table I for any other.

    The survivors' rule and the chains of mutations are not in the paper but in the settings published with it.
    """
    config = GPConfig(method="population", generations=LONGER.get(task, 50), seed=seed, old_share=0.1, chain_ratio=1.0)
    if task == "restack":
        return dataclasses.replace(config, population=32, generations=200, p_add=0.1, p_delete=0.3, p_change=0.6)
    return config
