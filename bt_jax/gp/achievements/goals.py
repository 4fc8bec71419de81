"""What the search knows of a domain, and what an episode tells it.

Legend: M offspring, A achievements, G groups of leaves; V and N as in `encoding.arrays`.
"""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Float32, Int32, UInt8

from bt_jax._util.errors import UserError
from bt_jax.encoding.status import Status

__all__ = ["FAILED", "MAX_ACHIEVEMENTS", "SUCCEEDED", "Goals", "Measured"]

MAX_ACHIEVEMENTS = 63  # bits of the key under which trees are kept
FAILED, SUCCEEDED = 1 << Status.FAILURE, 1 << Status.SUCCESS  # bits of a trace


@dataclasses.dataclass(frozen=True)
class Goals:
    """Which leaves and which achievements belong together.

    Two leaves of one group get in each other's way: a tree needs one of them. An achievement that concerns a group is
    brought about by one of its leaves; one that concerns none, -1, is a step on the way. `guard` is the token of the
    condition that holds from then on once such a step was done, 0 if there is none. `node_cost` is by how much fitness falls
    with each node.

    Where episodes differ by chance, a tree counts as having an achievement, or as solving the task, that is there in a share
    of `often` of them. `before` are leaves that may help the leaf behind them, 0 for none.
    """

    group: Int32[np.ndarray, " V"]  # of each token, -1 for leaves of no group
    concerns: Int32[np.ndarray, " A"]
    guard: Int32[np.ndarray, " A"]
    node_cost: float = 0.0
    often: float = 1.0
    before: Int32[np.ndarray, "V H"] | None = None

    def check(self) -> None:
        """Raise UserError if there are too many achievements."""
        if len(self.concerns) > MAX_ACHIEVEMENTS:
            raise UserError(
                f"{len(self.concerns)} targets and subgoals are too many; use at most {MAX_ACHIEVEMENTS} together"
            )

    def wanted(self) -> Int32[np.ndarray, " G"]:
        """Return of how many leaves of each group a tree needs to succeed: one for each achievement that it concerns."""
        return np.bincount(self.concerns[self.concerns >= 0], minlength=self.num_groups).astype(np.int32)

    @property
    def num_groups(self) -> int:
        """G."""
        return int(max(self.group.max(initial=-1), self.concerns.max(initial=-1))) + 1


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Measured:
    """What the episodes of M trees have told."""

    fitness: Float32[np.ndarray, "*R M"]
    solved: Float32[np.ndarray, "*R M"]  # share of the episodes
    achieved: Float32[np.ndarray, "*R M A"]  # share of the episodes
    missed: Float32[np.ndarray, "*R M A"]  # by how much fitness fell with what each lacks, mean of the episodes
    trace: UInt8[np.ndarray, "*R M N"]  # what each leaf has returned in any of them (see `encoding.tick.Ticked`)
