"""How a training measures individuals: settings that the command line shows, so that nothing heavy is imported here."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from bt_jax._util.errors import UserError
from bt_jax.tasks.task import Task

__all__ = ["CONFIRMED", "CONFIRMING", "UNSEEN", "Backend", "Evaluator", "Level", "Settings"]

Level = Literal["physics", "kinematic"]
Backend = Literal["auto", "mujoco", "mjx"]
Evaluator = Literal["table", "rollout"]
UNSEEN = 1 << 20  # seeds of layouts for tests; training uses the seeds of its runs
CONFIRMING = 1 << 21  # seeds of layouts in which a run tries its best trees before it ends,
CONFIRMED = 30  # so many
LAYOUTS = (
    4  # in which individuals are measured where things go wrong: with 5 draws each, a success rate is known to 0.1
)


@dataclasses.dataclass(frozen=True)
class Settings:
    """How individuals are measured."""

    level: Level = "physics"
    """physics: rigid bodies and contacts; kinematic: boxes drop to their support, for a quick look"""
    backend: Backend = "auto"
    """engine of the physics level; auto takes mjx on a GPU and mujoco on a CPU"""
    implementation: Literal["jax", "warp"] = "jax"
    """of mjx; warp is meant for NVIDIA GPUs and was run only once, on a CPU"""
    evaluator: Evaluator = "table"
    """table: simulate each distinct transition once, and rollout where fewer than 30 % of them come again; rollout: simulate
    every transition of every episode"""
    layouts: int | None = None
    """layouts K in which every individual of a run is measured; its fitness is the mean; auto: 1, and 4 where things go
    wrong"""
    draws: int = 5
    """where things go wrong (--faults): draws of chance in which every individual is measured in each layout"""
    robust: float = 1.0
    """with less than 1, fitness is the mean of this share of the episodes, the worst ones, instead of all: 0.2 makes trees
    careful (the conditional value at risk)"""
    test_layouts: int = 100
    """unseen layouts in which the learnt tree is tested at the end"""
    memory: float = 4.0
    """GB that the transition table may take; once it is full, it begins again, which takes time and changes no result"""

    def episodes(self, task: Task) -> int:
        """Return in how many episodes every individual of a run is measured."""
        return self.layouts_of(task) * self.draws_of(task)

    def layouts_of(self, task: Task) -> int:
        """Return in how many layouts every individual of a run is measured."""
        if self.layouts is not None:
            return self.layouts
        return 1 if task.faults is None else LAYOUTS

    def draws_of(self, task: Task) -> int:
        """Return how many draws of chance there are in each layout: 1 where nothing goes wrong."""
        return 1 if task.faults is None else self.draws

    def check(self) -> None:
        """Raise UserError for a setting that cannot work."""
        for name in ("layouts", "draws", "test_layouts"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise UserError(f"{name} is {value}; choose 1 or more")
        if not 0 < self.robust <= 1:
            raise UserError(f"robust is {self.robust:g}; choose a share of the episodes, above 0 and at most 1")
        if not 0 < self.memory < math.inf:
            raise UserError(f"memory is {self.memory:g} GB; choose more than 0")
