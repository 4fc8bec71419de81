"""The leaves of one evolution and the integers that stand for them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors.symbols import Behavior, Kind

__all__ = ["FIRST_LEAF", "Vocabulary"]

FIRST_LEAF = 3  # tokens 0, 1, 2 are padding, Sequence and Fallback


@dataclasses.dataclass(frozen=True)
class Vocabulary:
    """Leaves with their tokens. Token `FIRST_LEAF + i` is `leaves[i]`; conditions come first, then actions, then genes,
    so that each kind is one range of tokens."""

    leaves: tuple[Behavior, ...]

    def __post_init__(self) -> None:
        kinds = [leaf.kind for leaf in self.leaves]
        if kinds != sorted(kinds) or len(set(self.leaves)) < len(self.leaves):
            raise ValueError("leaves must be distinct and sorted by kind; use Vocabulary.of")
        subtasks = [leaf.args[0] for leaf in self.leaves if leaf.name == "subtask"]
        for name in subtasks:
            if subtasks.count(name) > 1:
                raise UserError(f"two different subtasks are called '{name}'; rename one of them")

    @staticmethod
    def of(leaves: Iterable[Behavior]) -> Vocabulary:
        """Distinct leaves, sorted by kind, otherwise in the order given."""
        return Vocabulary(tuple(sorted(dict.fromkeys(leaves), key=lambda leaf: leaf.kind)))

    def extended(self, leaves: Iterable[Behavior]) -> Vocabulary:
        """This vocabulary with more leaves; tokens may change."""
        return Vocabulary.of((*self.leaves, *leaves))

    def __len__(self) -> int:
        return FIRST_LEAF + len(self.leaves)

    @functools.cached_property
    def kinds(self) -> np.ndarray:
        """Kind of each token, int8[vocabulary]."""
        return np.array([Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK, *(leaf.kind for leaf in self.leaves)], np.int8)

    @functools.cached_property
    def _tokens(self) -> dict[Behavior, int]:
        return {leaf: FIRST_LEAF + i for i, leaf in enumerate(self.leaves)}

    def token(self, leaf: Behavior) -> int:
        """Token of a leaf. Raises UserError where it is not in the vocabulary."""
        try:
            return self._tokens[leaf]
        except KeyError:
            raise UserError(
                f"the leaf {leaf} is not among the behaviors of this task; add it to the pool first"
            ) from None

    def leaf(self, token: int) -> Behavior:
        return self.leaves[token - FIRST_LEAF]
