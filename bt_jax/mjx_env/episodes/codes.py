"""Outcomes of leaves as small numbers.

A leaf has few distinct outcomes: SUCCESS, FAILURE, and one for each action that it can run. Each is numbered for its leaf
in the order in which it is met, so that a state takes one byte a leaf instead of the two words of `LeafSemantics.outcomes`.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Int32, Int64, UInt

__all__ = ["OutcomeCodes", "TooManyOutcomesError"]

FIRST_CODES = 16
GROWTH = 4
NO_OUTCOME = -1  # no outcome is negative


class TooManyOutcomesError(Exception):
    """A leaf has more distinct outcomes than numbers of the given type."""


class OutcomeCodes:
    """The distinct outcomes of V leaves, each a pair of both layers, and their numbers."""

    def __init__(self, num_tokens: int, dtype: type[np.unsignedinteger]) -> None:
        self.dtype = dtype
        self._pairs = np.full((FIRST_CODES, num_tokens), NO_OUTCOME, np.int64)
        self._counts = np.zeros(num_tokens, int)

    @property
    def meanings(self) -> Int32[np.ndarray, "2 V K"]:
        """The outcomes in the first and the second layer that each number of each leaf stands for."""
        return np.ascontiguousarray(self._pairs[..., None].view(np.int32).transpose(2, 1, 0))

    def encode(self, outcomes: Int32[np.ndarray, "2 S V"]) -> tuple[UInt[np.ndarray, "S V"], bool]:
        """Return the number of each outcome, and whether there are new ones. Raise TooManyOutcomesError."""
        pairs = np.ascontiguousarray(outcomes.transpose(1, 2, 0)).view(np.int64)[..., 0]
        codes = np.zeros(pairs.shape, self.dtype)
        self._number(pairs, codes, 1)
        columns = np.arange(codes.shape[1])
        unknown = self._pairs[codes, columns] != pairs
        found_new = bool(unknown.any())
        while unknown.any():
            first = self._enter(pairs, unknown)
            self._number(pairs, codes, first)
            unknown = self._pairs[codes, columns] != pairs
        return codes, found_new

    def _number(self, pairs: Int64[np.ndarray, "S V"], codes: UInt[np.ndarray, "S V"], first: int) -> None:
        """Set the codes from `first` on where they stand for the pairs."""
        for code in range(first, int(self._counts.max(initial=0))):
            np.copyto(codes, self.dtype(code), where=pairs == self._pairs[code])

    def _enter(self, pairs: Int64[np.ndarray, "S V"], unknown: np.ndarray) -> int:
        """Number one unknown outcome of each leaf that has any; return the least of the new numbers."""
        columns = np.flatnonzero(unknown.any(axis=0))
        rows = unknown[:, columns].argmax(axis=0)
        codes = self._counts[columns]
        if codes.max() > np.iinfo(self.dtype).max:
            raise TooManyOutcomesError
        if codes.max() >= len(self._pairs):
            more = np.full(((GROWTH - 1) * len(self._pairs), self._pairs.shape[1]), NO_OUTCOME, np.int64)
            self._pairs = np.concatenate([self._pairs, more])
        self._pairs[codes, columns] = pairs[rows, columns]
        self._counts[columns] += 1
        return int(codes.min())
