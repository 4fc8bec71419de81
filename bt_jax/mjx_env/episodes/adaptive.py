"""The table where transitions come again, and rollouts where they do not."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32

from bt_jax.encoding.arrays import Trees
from bt_jax.mjx_env.episodes.evaluator import Evaluation, TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.world import World

__all__ = ["LEAST_HITS", "AdaptiveEvaluator"]

LEAST_HITS = 0.3  # of the commands that episodes run, the share whose transition a useful table knows already
TRIED = 50_000  # commands after which that is judged: the first generations have little in common


class AdaptiveEvaluator:
    """Evaluate populations with a table until fewer than LEAST_HITS of the commands that episodes run come again, and from
    then on with rollouts. These are on the host, where they have the table's results to the last digit, so that it makes no
    difference when that happens, or whether a run was resumed in between."""

    def __init__(self, table: TableEvaluator, physics: Physics) -> None:
        self.table = table
        self._rollout = RolloutEvaluator(
            table.table.semantics, physics, batch=table.batch, trace=table.trace, on_host=True
        )

    @property
    def rolls_out(self) -> bool:
        """Whether the table was given up."""
        return self.table.num_followed >= TRIED and self.table.hit_rate < LEAST_HITS

    @property
    def num_broken(self) -> int:
        """Transitions whose simulation diverged, and episodes of rollouts in which one did."""
        return self.table.num_broken + self._rollout.num_broken

    def __call__(
        self,
        trees: Trees,
        layouts: World,
        which: Int32[np.ndarray, "P K"] | None = None,
        fates: Fates | None = None,
    ) -> Evaluation:
        """Run P trees [P, N] in K layouts each, as `TableEvaluator` does."""
        return (self._rollout if self.rolls_out else self.table)(trees, layouts, which, fates)
