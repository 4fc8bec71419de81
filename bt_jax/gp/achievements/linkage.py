"""Linkage learning: which leaf achieves what, and in which order two leaves work."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int32

from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import NOTED
from bt_jax.gp.achievements.goals import FAILED, SUCCEEDED, Goals, Measured
from bt_jax.gp.achievements.pairs import Pairs

__all__ = ["Linkage"]

SEED = 0.5  # credit of what the tree to start from has, before any episode
HOPE = 0.75  # share of two leaves that is expected to work in an order that was not tried
DISTURBED = (1.0, 0.5, 0.25)  # by how much at most an order is disturbed, one of these


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Linkage:
    """Counts over all episodes of a run (NumPy). A leaf works in an episode if it succeeded and an achievement that concerns
    it was there at the end; of several leaves of its group that succeeded, the last did it."""

    tested: Int32[np.ndarray, " V"]  # episodes in which a leaf was ticked
    achieves: Float32[np.ndarray, "V A"]  # in which it worked, by achievement
    pairs: Pairs  # of leaves of groups that an achievement concerns
    failed: Int32[np.ndarray, " V"]  # episodes in which a leaf has failed

    @staticmethod
    def empty(goals: Goals, baseline: Trees | None = None) -> Linkage:
        """Return the counts before the first episode: each leaf of a baseline [N], if there is one, is expected to achieve
        what concerns its group, in the order in which they stand."""
        tokens, achievements = len(goals.group), len(goals.concerns)
        achieves = np.zeros((tokens, achievements), np.float32)
        pairs = Pairs.empty()
        if baseline is not None:
            leaves = np.asarray(baseline.tokens)
            leaves = leaves[(leaves >= FIRST_LEAF) & (goals.group[leaves] >= 0)]
            achieves[leaves] = SEED * (goals.group[leaves][:, None] == goals.concerns)
            pairs = _in_order_of(leaves[np.isin(goals.group[leaves], goals.concerns)])
        return Linkage(np.zeros(tokens, np.int32), achieves, pairs, np.zeros(tokens, np.int32))

    def updated(self, trees: Trees, measured: Measured, goals: Goals) -> Linkage:
        """Return the counts after the episodes of M trees."""
        tokens, trace = np.asarray(trees.tokens, np.int64), measured.trace
        leaf = (tokens >= FIRST_LEAF) & (goals.group[tokens] >= 0)
        ticked, succeeded = leaf & (trace > 0), leaf & (trace & SUCCEEDED > 0)
        tested = self.tested.copy()
        np.add.at(tested, tokens[ticked], 1)
        failed = self.failed.copy()
        np.add.at(failed, tokens[leaf & (trace & FAILED > 0)], 1)

        concerned = goals.group[tokens][..., None] == goals.concerns  # [M, N, A]
        concerned &= (_later(np.where(succeeded, goals.group[tokens], -1)) < goals.wanted()[goals.group[tokens]])[
            ..., None
        ]
        concerned |= (trace & NOTED > 0)[..., None] & (goals.concerns < 0)  # a leaf that told of a step has done it
        credit = np.where(succeeded[..., None] & concerned, measured.achieved[:, None, :], np.float32(0))
        achieves = self.achieves.copy()
        np.add.at(achieves, tokens[leaf], credit[leaf])

        works = credit.max(axis=-1, initial=0)  # [M, N]
        longest = max(int(trees.sizes[:, 0].max(initial=0)), 1)
        first, second = np.triu_indices(longest, 1)
        ordered = leaf & np.isin(goals.group[tokens], goals.concerns)  # what is ever put in order
        tree, pair = np.nonzero((ticked & ordered)[:, first] & ordered[:, second])
        before, after = first[pair], second[pair]
        pairs = self.pairs.with_(
            tokens[tree, before],
            tokens[tree, after],
            np.ones(len(tree), np.float32),
            (works[tree, before] + works[tree, after]) / 2,
        )
        return Linkage(tested, achieves, pairs, failed)

    def failing(self) -> Float32[np.ndarray, " V"]:
        """Return in which share of the episodes each leaf has failed in which it was ticked."""
        return (self.failed / np.maximum(self.tested, 1)).astype(np.float32)

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
        count = len(curious)
        leaves = self.least_tested(rng, goals.concerns[[achievement]], goals, count)[:, 0]
        weights = np.cumsum(self.achieves[:, achievement], dtype=np.float64)
        if weights[-1] > 0:
            leaves = np.where(curious, leaves, _drawn(rng, weights, count))
        return leaves

    def step_leaves(self, rng: np.random.Generator, step: int, count: int) -> Int32[np.ndarray, " M"] | None:
        """Return for M trees leaves that have done a step on the way, in proportion to how often; None if no leaf has done
        it alone."""
        weights = np.cumsum(self.achieves[:, step], dtype=np.float64)
        return _drawn(rng, weights, count) if weights[-1] > 0 else None

    def in_order(self, rng: np.random.Generator, leaves: Int32[np.ndarray, "M K"]) -> Int32[np.ndarray, "M K"]:
        """Return each row of leaves in an order that has worked; 0, no leaf, comes last, and what nothing is known of comes
        in random order.

        Again and again the leaf goes next that hinders the others least, more or less: some rows are disturbed much, some
        hardly.
        """
        count, length = leaves.shape
        stood, worked = self.pairs.counts(leaves[:, :, None], leaves[:, None, :])
        share = (worked + HOPE) / (stood + 1)
        gain = share - share.swapaxes(1, 2)  # [m, i, j]: how much more works with i before j
        waiting, rows = leaves > 0, np.arange(count)
        disturbed = rng.choice(DISTURBED, size=(count, 1))
        result = np.zeros_like(leaves)
        for place in range(length):
            hinders = np.where(waiting[:, :, None], gain, 0).max(axis=1, initial=0)  # [m, j]
            hinders += rng.random((count, length)) * disturbed
            choice = np.where(waiting, hinders, np.inf).argmin(axis=1)
            result[:, place] = np.where(waiting[rows, choice], leaves[rows, choice], 0)
            waiting[rows, choice] = False
        return result


def _in_order_of(leaves: Int[np.ndarray, " L"]) -> Pairs:
    """Return counts by which leaves work in the order in which they stand, and not the other way round."""
    forward = np.unique(leaves[np.array(np.triu_indices(len(leaves), 1))], axis=1)
    both = np.unique(np.concatenate([forward, forward[::-1]], axis=1), axis=1)
    once, others = (np.full(pairs.shape[1], SEED, np.float32) for pairs in (forward, both))
    pairs = Pairs.empty().with_(both[0], both[1], others, np.zeros_like(others))
    return pairs.with_(forward[0], forward[1], np.zeros_like(once), once)


def _later(groups: Int32[np.ndarray, "M N"]) -> Int[np.ndarray, "M N"]:
    """Return how many nodes of the same group come behind each."""
    behind = np.triu(np.ones((groups.shape[1],) * 2, bool), 1)
    return ((groups[:, :, None] == groups[:, None, :]) & behind).sum(axis=2)


def _drawn(rng: np.random.Generator, weights: Float64[np.ndarray, " V"], count: int) -> Int32[np.ndarray, " M"]:
    """Draw tokens in proportion to weights, of which the sums so far are given."""
    at = np.searchsorted(weights, rng.random(count) * weights[-1], side="right")
    return np.minimum(at, len(weights) - 1).astype(np.int32)
