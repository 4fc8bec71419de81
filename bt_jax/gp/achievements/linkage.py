"""Linkage learning: which leaf achieves what, and which of two leaves has to come first."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int32

from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import NOTED
from bt_jax.gp.achievements.goals import FAILED, SUCCEEDED, Goals, Measured

__all__ = ["Linkage"]

SEED = 0.5  # credit of what the tree to start from has, before any episode


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Linkage:
    """Counts over all episodes of a run (NumPy)."""

    tested: Int32[np.ndarray, " V"]  # in which a leaf was ticked
    achieves: Float32[np.ndarray, "V A"]  # in which it succeeded, and the achievement was there at the end
    order: Float32[
        np.ndarray, "V V"
    ]  # [g, h], g before h: in which both achieved something, less those in which h failed

    @staticmethod
    def empty(goals: Goals, baseline: Trees | None = None) -> Linkage:
        """Return the counts before the first episode: each leaf of a baseline [N], if there is one, is expected to achieve
        what concerns its group, in the order in which they stand."""
        tokens, achievements = len(goals.group), len(goals.concerns)
        achieves, order = np.zeros((tokens, achievements), np.float32), np.zeros((tokens, tokens), np.float32)
        if baseline is not None:
            leaves = baseline.tokens[(baseline.tokens >= FIRST_LEAF) & (goals.group[baseline.tokens] >= 0)]
            achieves[leaves] = SEED * (goals.group[leaves][:, None] == goals.concerns)
            first, second = np.triu_indices(len(leaves), 1)
            order[leaves[first], leaves[second]] = SEED
        return Linkage(np.zeros(tokens, np.int32), achieves, order)

    def updated(self, trees: Trees, measured: Measured, goals: Goals) -> Linkage:
        """Return the counts after the episodes of M trees."""
        tokens, trace = trees.tokens.astype(np.int64), measured.trace
        leaf = (tokens >= FIRST_LEAF) & (goals.group[tokens] >= 0)
        succeeded, failed = leaf & (trace & SUCCEEDED > 0), leaf & (trace & FAILED > 0)
        tested = self.tested.copy()
        np.add.at(tested, tokens[leaf & (trace > 0)], 1)

        concerned = goals.group[tokens][..., None] == goals.concerns  # [M, N, A]
        concerned |= (trace & NOTED > 0)[..., None] & (goals.concerns < 0)  # a leaf that told of a step has done it
        credit = np.where(succeeded[..., None] & concerned, measured.achieved[:, None, :], np.float32(0))
        achieves = self.achieves.copy()
        np.add.at(achieves, tokens[leaf], credit[leaf])

        worked = credit.max(axis=-1, initial=0)  # [M, N]
        longest = max(int(trees.sizes[:, 0].max(initial=0)), 1)
        first, second = np.triu_indices(longest, 1)
        both = np.minimum(worked[:, first], worked[:, second])
        hindered = succeeded[:, first] & failed[:, second]
        order = self.order.copy()
        gain = both - hindered.astype(np.float32)
        np.add.at(order, (tokens[:, first], tokens[:, second]), gain)
        return Linkage(tested, achieves, order)

    def known(self) -> Bool[np.ndarray, " A"]:
        """Return which achievements a leaf was seen to bring about."""
        return self.achieves.max(axis=0, initial=0) > SEED

    def untested(self, goals: Goals) -> bool:
        """Whether leaves that might bring about what no leaf is known for wait to be tested."""
        groups = goals.concerns[~self.known() & (goals.concerns >= 0)]
        return bool((self.tested[np.isin(goals.group, groups)] == 0).any())

    def least_tested(
        self, rng: np.random.Generator, groups: Int32[np.ndarray, " G"], goals: Goals, count: int
    ) -> Int32[np.ndarray, "M G"]:
        """Return leaves of each group for `count` trees, the least tested first and each as often as the others; 0 for a
        group without leaves."""
        drawn = np.zeros((count, len(groups)), np.int32)
        for column, group in enumerate(groups):
            leaves = np.flatnonzero(goals.group == group)
            if leaves.size:
                ranked = leaves[np.argsort(self.tested[leaves] + rng.random(leaves.size))]
                drawn[:, column] = np.resize(ranked, count)
        return drawn

    def donors(
        self, rng: np.random.Generator, achievement: int, goals: Goals, curious: Bool[np.ndarray, " M"]
    ) -> Int32[np.ndarray, " M"]:
        """Return leaves for an achievement, for M trees: those that were seen to bring it about, in proportion to how often;
        where none was, and for trees that are curious, the least tested of the group that it concerns."""
        weights = np.cumsum(self.achieves[:, achievement], dtype=np.float64)
        concerned = goals.concerns[achievement : achievement + 1]
        leaves = self.least_tested(rng, concerned, goals, len(curious))[:, 0]
        if weights[-1] > 0:
            leaves = np.where(curious, leaves, _drawn(rng, weights, len(curious)))
        return leaves.astype(np.int32)

    def step_leaves(self, rng: np.random.Generator, step: int, count: int) -> Int32[np.ndarray, " M"] | None:
        """Return for `count` trees leaves that have done a step on the way, in proportion to how often; None if no leaf has
        done it alone."""
        weights = np.cumsum(self.achieves[:, step], dtype=np.float64)
        return _drawn(rng, weights, count) if weights[-1] > 0 else None

    def in_order(self, rng: np.random.Generator, leaves: Int32[np.ndarray, "M K"]) -> Int32[np.ndarray, "M K"]:
        """Return each row of leaves in an order that has worked; 0, no leaf, comes last, and what nothing is known of comes
        in random order.

        Again and again the leaf goes next that the others have the least reason to precede.
        """
        count, length = leaves.shape
        forward = self.order[leaves[:, :, None], leaves[:, None, :]]
        before = forward - forward.swapaxes(1, 2)  # [m, i, j]: how much speaks for i before j
        waiting, rows = leaves > 0, np.arange(count)
        result = np.zeros_like(leaves)
        for place in range(length):
            against = np.where(waiting[:, :, None], before, 0).max(axis=1)  # [m, j]
            against = np.maximum(against, 0) + rng.random((count, length)) * 0.5
            choice = np.where(waiting, against, np.inf).argmin(axis=1)
            result[:, place] = np.where(waiting[rows, choice], leaves[rows, choice], 0)
            waiting[rows, choice] = False
        return result


def _drawn(rng: np.random.Generator, weights: Float64[np.ndarray, " V"], count: int) -> Int32[np.ndarray, " M"]:
    """Draw tokens in proportion to weights, of which the sums so far are given."""
    at = np.searchsorted(weights, rng.random(count) * weights[-1], side="right")
    return np.minimum(at, len(weights) - 1).astype(np.int32)
