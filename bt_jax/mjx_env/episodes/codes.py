"""Outcomes of leaves as small numbers.

A leaf has few distinct outcomes: SUCCESS, FAILURE, and one for each action that it can run. Each is numbered for its leaf
in the order in which it is met, so that a state takes one byte a leaf instead of the two words of `LeafSemantics.outcomes`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int, Int32, Int64, UInt

__all__ = ["NOT_COMPUTED", "OutcomeCodes", "TooManyOutcomesError"]

NOT_COMPUTED = np.int32(np.iinfo(np.int32).min)  # the only negative outcome
FIRST_CODES = 16
GROWTH = 4


class TooManyOutcomesError(Exception):
    """A leaf has more distinct outcomes than numbers of the given type."""


class OutcomeCodes:
    """The distinct outcomes of V tokens, each a pair of both layers, and their numbers. Number 0 stands for an outcome that
    has not been computed."""

    def __init__(self, num_tokens: int, dtype: type[np.unsignedinteger]) -> None:
        self.dtype = dtype
        self._pairs = _not_computed(FIRST_CODES, num_tokens)
        self._counts = np.ones(num_tokens, int)

    @property
    def meanings(self) -> Int32[np.ndarray, "2 V K"]:
        """The outcomes in the first and the second layer that each number of each token stands for."""
        return np.ascontiguousarray(self._pairs[..., None].view(np.int32).transpose(2, 1, 0))

    def encode(
        self, outcomes: Int32[np.ndarray, "2 S m"], tokens: Int[np.ndarray, " m"]
    ) -> tuple[UInt[np.ndarray, "S m"], bool]:
        """Return the numbers of outcomes of some tokens, and whether there are new ones. Raise TooManyOutcomesError."""
        pairs = np.ascontiguousarray(outcomes.transpose(1, 2, 0)).view(np.int64)[..., 0]
        codes, known = self._numbered(pairs, tokens)
        found_new = not known.all()
        while not known.all():
            self._enter(pairs, known, tokens)
            codes, known = self._numbered(pairs, tokens)
        return codes, found_new

    def _numbered(
        self, pairs: Int64[np.ndarray, "S m"], tokens: Int[np.ndarray, " m"]
    ) -> tuple[UInt[np.ndarray, "S m"], Bool[np.ndarray, "S m"]]:
        """Return the numbers of outcomes, and which are known; the numbers of the others mean nothing."""
        own = self._pairs[: max(2, self._counts.max()), tokens]
        codes = np.ones(pairs.shape, self.dtype)
        for code in range(2, len(own)):
            np.copyto(codes, self.dtype(code), where=pairs == own[code])
        return codes, own[codes, np.arange(len(tokens))] == pairs

    def _enter(
        self, pairs: Int64[np.ndarray, "S m"], known: Bool[np.ndarray, "S m"], tokens: Int[np.ndarray, " m"]
    ) -> None:
        """Number one unknown outcome of each token that has any."""
        columns = np.flatnonzero(~known.all(axis=0))
        rows, tokens = known[:, columns].argmin(axis=0), tokens[columns]
        codes = self._counts[tokens]
        if codes.max() > np.iinfo(self.dtype).max:
            raise TooManyOutcomesError
        if codes.max() >= len(self._pairs):
            more = _not_computed((GROWTH - 1) * len(self._pairs), self._pairs.shape[1])
            self._pairs = np.concatenate([self._pairs, more])
        self._pairs[codes, tokens] = pairs[rows, columns]
        self._counts[tokens] += 1


def _not_computed(*shape: int) -> Int64[np.ndarray, "K V"]:
    return np.full((*shape, 2), NOT_COMPUTED).view(np.int64)[..., 0]
