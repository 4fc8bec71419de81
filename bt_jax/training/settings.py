"""How a training measures individuals: settings that the command line shows, so that nothing heavy is imported here."""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from bt_jax._util.errors import UserError

__all__ = ["CONFIRMED", "CONFIRMING", "UNSEEN", "Backend", "Evaluator", "Level", "Settings"]

Level = Literal["physics", "kinematic"]
Backend = Literal["auto", "mujoco", "mjx"]
Evaluator = Literal["table", "rollout"]
UNSEEN = 1 << 20  # seeds of layouts for tests; training uses the seeds of its runs
CONFIRMING = 1 << 21  # seeds of layouts in which a run tries its best trees before it ends,
CONFIRMED = 30  # so many


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
    """table: simulate each distinct transition once; rollout: simulate every transition of every episode"""
    layouts: int = 1
    """layouts K in which every individual of a run is measured; its fitness is the mean"""
    test_layouts: int = 100
    """unseen layouts in which the learnt tree is tested at the end"""
    memory: float = 4.0
    """GB that the transition table may take; once it is full, it begins again, which takes time and changes no result"""

    def check(self) -> None:
        """Raise UserError for a setting that cannot work."""
        for name in ("layouts", "test_layouts"):
            if getattr(self, name) < 1:
                raise UserError(f"{name} is {getattr(self, name)}; choose 1 or more")
        if not 0 < self.memory < math.inf:
            raise UserError(f"memory is {self.memory:g} GB; choose more than 0")
