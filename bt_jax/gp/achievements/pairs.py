"""Counts of pairs of leaves. Of all the pairs that a gene pool has, a run meets few, and only these take memory."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Float32, Int, Int32

__all__ = ["Pairs"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Pairs:
    """Counts of K pairs of tokens, sorted (NumPy); all others are 0."""

    keys: Int32[np.ndarray, " K"]  # the first token in the upper 16 bits, the second in the lower
    stood: Float32[np.ndarray, " K"]  # episodes in which the first stood before the second, and was ticked
    worked: Float32[np.ndarray, " K"]  # of these, in which they worked: each of the two counts half

    @staticmethod
    def empty() -> Pairs:
        """Return the counts of no pair."""
        return Pairs(np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32))

    def with_(
        self,
        first: Int[np.ndarray, " P"],
        second: Int[np.ndarray, " P"],
        stood: Float32[np.ndarray, " P"],
        worked: Float32[np.ndarray, " P"],
    ) -> Pairs:
        """Return the counts after more was counted of pairs, which may repeat."""
        added = _keys(first, second)
        fresh = np.setdiff1d(added, self.keys)
        place = np.searchsorted(self.keys, fresh)
        keys = np.insert(self.keys, place, fresh)
        counts = np.insert(self.stood, place, 0), np.insert(self.worked, place, 0)
        at = np.searchsorted(keys, added)
        for count, more in zip(counts, (stood, worked), strict=True):
            np.add.at(count, at, more)
        return Pairs(keys, *counts)

    def counts(
        self, first: Int[np.ndarray, "*#M"], second: Int[np.ndarray, "*#M"]
    ) -> tuple[Float32[np.ndarray, "*#M"], Float32[np.ndarray, "*#M"]]:
        """Return `stood` and `worked` of pairs."""
        if not len(self.keys):
            nothing = np.zeros(np.broadcast_shapes(first.shape, second.shape), np.float32)
            return nothing, nothing
        wanted = _keys(first, second)
        at = np.minimum(np.searchsorted(self.keys, wanted), len(self.keys) - 1)
        met = self.keys[at] == wanted
        return np.where(met, self.stood[at], np.float32(0)), np.where(met, self.worked[at], np.float32(0))


def _keys(first: Int[np.ndarray, "*#M"], second: Int[np.ndarray, "*#M"]) -> Int32[np.ndarray, "*#M"]:
    """Return pairs of tokens, which are below 2^15, as one number each."""
    return first.astype(np.int32) << 16 | second.astype(np.int32)
