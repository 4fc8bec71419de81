"""The leaves of one evolution and the integers that stand for them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from typing import Generic

import numpy as np
from jaxtyping import Int8

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Kind, L

__all__ = ["FIRST_LEAF", "Vocabulary"]

FIRST_LEAF = 3  # tokens 0, 1, 2 are padding, Sequence and Fallback


@dataclasses.dataclass(frozen=True)
class Vocabulary(Generic[L]):
    """Leaves of any domain with their tokens. Token `FIRST_LEAF + i` is `leaves[i]`; conditions come first, then actions,
    then genes, so that each kind is one range of tokens."""

    leaves: tuple[L, ...]

    def __post_init__(self) -> None:
        kinds = [leaf.kind for leaf in self.leaves]
        if kinds != sorted(kinds) or len(set(self.leaves)) < len(self.leaves):
            raise ValueError("leaves must be distinct and sorted by kind; use Vocabulary.of")
        labels: set[str] = set()
        for leaf in self.leaves:
            if leaf.kind not in (Kind.CONDITION, Kind.ACTION, Kind.GENE):
                raise UserError(f"the leaf {leaf} is a {leaf.kind.name}; make it a CONDITION, an ACTION or a GENE")
            if leaf.label in labels:
                raise UserError(f"two different behaviors are called '{leaf.label}'; rename one of them")
            labels.add(leaf.label)

    @staticmethod
    def of(leaves: Iterable[L]) -> Vocabulary[L]:
        """Return a vocabulary of the distinct leaves, sorted by kind, otherwise in the order given."""
        return Vocabulary(tuple(sorted(dict.fromkeys(leaves), key=lambda leaf: leaf.kind)))

    def extended(self, leaves: Iterable[L]) -> Vocabulary[L]:
        """Return this vocabulary with more leaves; tokens may change."""
        return Vocabulary.of((*self.leaves, *leaves))

    def __len__(self) -> int:
        return FIRST_LEAF + len(self.leaves)

    @functools.cached_property
    def kinds(self) -> Int8[np.ndarray, " V"]:
        """Kind of each token."""
        return np.array([Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK, *(leaf.kind for leaf in self.leaves)], np.int8)

    @functools.cached_property
    def _tokens(self) -> dict[L, int]:
        return {leaf: FIRST_LEAF + i for i, leaf in enumerate(self.leaves)}

    def token(self, leaf: L) -> int:
        """Return the token of a leaf. Raise UserError if it is not in the vocabulary."""
        try:
            return self._tokens[leaf]
        except KeyError:
            raise UserError(f"the leaf {leaf} is not in the vocabulary; add it with Vocabulary.extended") from None

    def leaf(self, token: int) -> L:
        return self.leaves[token - FIRST_LEAF]
