"""The leaves and decorators of one evolution and the integers that stand for them."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from typing import Generic

import numpy as np
from jaxtyping import Int8, UInt8

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Decorator, Kind, L

__all__ = ["FIRST_LEAF", "Vocabulary"]

FIRST_LEAF = 3  # tokens 0, 1, 2 are padding, Sequence and Fallback


@dataclasses.dataclass(frozen=True)
class Vocabulary(Generic[L]):
    """Leaves of any domain, and decorators, with their tokens. Token `FIRST_LEAF + i` is `leaves[i]`, and the tokens of the
    decorators follow; conditions come first, then actions, genes, retries and timeouts, so that each kind is one range of
    tokens."""

    leaves: tuple[L, ...]
    decorators: tuple[Decorator, ...] = ()

    def __post_init__(self) -> None:
        kinds = [leaf.kind for leaf in self.leaves] + [decorator.kind for decorator in self.decorators]
        if kinds != sorted(kinds) or len({*self.leaves, *self.decorators}) < len(kinds):
            raise ValueError("leaves and decorators must be distinct and sorted by kind; use Vocabulary.of")
        labels: set[str] = set()
        for leaf in self.leaves:
            if leaf.kind not in (Kind.CONDITION, Kind.ACTION, Kind.GENE):
                raise UserError(f"the leaf {leaf} is a {leaf.kind.name}; make it a CONDITION, an ACTION or a GENE")
            if leaf.label in labels:
                raise UserError(f"two different behaviors are called '{leaf.label}'; rename one of them")
            labels.add(leaf.label)

    @staticmethod
    def of(leaves: Iterable[L], decorators: Iterable[Decorator] = ()) -> Vocabulary[L]:
        """Return a vocabulary of the distinct leaves and decorators, sorted by kind, otherwise in the order given."""
        return Vocabulary(
            tuple(sorted(dict.fromkeys(leaves), key=lambda leaf: leaf.kind)),
            tuple(sorted(dict.fromkeys(decorators), key=lambda decorator: decorator.kind)),
        )

    def extended(self, leaves: Iterable[L], decorators: Iterable[Decorator] = ()) -> Vocabulary[L]:
        """Return this vocabulary with more leaves and decorators; tokens may change."""
        return Vocabulary.of((*self.leaves, *leaves), (*self.decorators, *decorators))

    def without(self, leaves: Iterable[L]) -> Vocabulary[L]:
        """Return this vocabulary without some leaves; tokens may change. Raise UserError if one is not in it."""
        gone = set(leaves)
        if unknown := sorted(str(leaf) for leaf in gone if leaf not in self._tokens):
            raise UserError(f"evolution would not use {unknown[0]} anyway; give a leaf as it stands in the gene pool")
        return Vocabulary(tuple(leaf for leaf in self.leaves if leaf not in gone), self.decorators)

    def __len__(self) -> int:
        return FIRST_LEAF + len(self.leaves) + len(self.decorators)

    @functools.cached_property
    def kinds(self) -> Int8[np.ndarray, " V"]:
        """Kind of each token."""
        own = [leaf.kind for leaf in self.leaves] + [decorator.kind for decorator in self.decorators]
        return np.array([Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK, *own], np.int8)

    @functools.cached_property
    def limits(self) -> UInt8[np.ndarray, " V"]:
        """Up to what each token counts; 0 for all but decorators."""
        numbers = [decorator.number for decorator in self.decorators]
        return np.array([0] * (FIRST_LEAF + len(self.leaves)) + numbers, np.uint8)

    @property
    def symbols(self) -> tuple[L | Decorator, ...]:
        """Leaves and decorators, in the order of their tokens."""
        return (*self.leaves, *self.decorators)

    @functools.cached_property
    def _tokens(self) -> dict[L | Decorator, int]:
        return {symbol: FIRST_LEAF + i for i, symbol in enumerate(self.symbols)}

    def token(self, symbol: L | Decorator) -> int:
        """Return the token of a leaf or decorator. Raise UserError if it is not in the vocabulary."""
        try:
            return self._tokens[symbol]
        except KeyError:
            what = f"decorator {symbol.kind.name.lower()}({symbol.number})" if isinstance(symbol, Decorator) else None
            raise UserError(
                f"the {what or f'leaf {symbol}'} is not in the vocabulary; add it with Vocabulary.extended"
            ) from None

    def leaf(self, token: int) -> L:
        return self.leaves[token - FIRST_LEAF]

    def decorator(self, token: int) -> Decorator:
        return self.decorators[token - FIRST_LEAF - len(self.leaves)]
