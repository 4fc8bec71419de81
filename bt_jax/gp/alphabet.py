"""What the genetic operators know of a vocabulary, of whatever domain: how many conditions, actions and genes it has.

Tokens of one kind are one range, so that a set of allowed leaves is a range with a few holes, and a uniform draw from it
is arithmetic.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int8, Int32, UInt32

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF, Vocabulary

__all__ = ["Alphabet", "LeafSet", "scaled"]

Count = int | Int32[Array | np.ndarray, ""]
OUTSIDE = 1 << 20  # larger than any token


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Alphabet:
    """Numbers of leaves by kind; tokens follow in this order from `FIRST_LEAF`.

    A pytree of three integers, so that code compiled for one task serves all; hashable, if a static argument of jit is
    wanted.
    """

    num_conditions: Count
    num_actions: Count
    num_genes: Count

    @staticmethod
    def of(vocabulary: Vocabulary) -> Alphabet:
        return Alphabet.of_kinds(vocabulary.kinds)

    @staticmethod
    def of_kinds(token_kinds: Int8[np.ndarray, " V"]) -> Alphabet:
        """Return the numbers for the kinds of all tokens."""
        kinds = token_kinds.tolist()
        return Alphabet(kinds.count(Kind.CONDITION), kinds.count(Kind.ACTION), kinds.count(Kind.GENE))

    @property
    def first_action(self) -> Count:
        return FIRST_LEAF + self.num_conditions

    @property
    def first_gene(self) -> Count:
        return self.first_action + self.num_actions

    @property
    def end(self) -> Count:
        """One past the last token."""
        return self.first_gene + self.num_genes

    @property
    def num_leaves(self) -> Count:
        return self.end - FIRST_LEAF

    @property
    def num_acts(self) -> Count:
        """Actions and genes."""
        return self.end - self.first_action

    def num_pairs(self, *, genes: bool) -> int:
        """Of all [leaf, action or gene], how many can be the two children of a control node with or without genes; the
        numbers must be concrete."""
        holes = 0 if genes else self.num_genes
        return max(int(self.num_acts - holes), 0) * max(int(self.num_leaves - holes - 1), 0)

    def check(self) -> None:
        """Raise UserError if no tree can be made."""
        if not self.num_pairs(genes=True):
            raise UserError("no tree can be made of these behaviors; give an action or gene and one more behavior")
        if self.end >= 1 << 15:
            raise UserError(f"{self.end} tokens do not fit in 16 bits; use fewer genes")

    def is_condition(self, token: Array) -> Bool[Array, "..."]:
        return (token >= FIRST_LEAF) & (token < self.first_action)

    def is_act(self, token: Array) -> Bool[Array, "..."]:
        """Return whether a token is an action or a gene."""
        return token >= self.first_action

    def is_gene(self, token: Array) -> Bool[Array, "..."]:
        return token >= self.first_gene

    def leaves(self, *forbidden: Array, conditions: Array, acts: Array, genes: Array) -> LeafSet:
        """Return the leaves of the wanted kinds (genes count only among acts), without the forbidden tokens."""
        low = jnp.where(conditions, jnp.int32(FIRST_LEAF), self.first_action)
        high = jnp.where(acts, jnp.where(genes, jnp.int32(self.end), self.first_gene), self.first_action)
        holes: list[Array] = []
        for token in forbidden:
            inside = (token >= low) & (token < high)
            for other in holes:
                inside &= token != other
            holes.append(jnp.where(inside, token, OUTSIDE))
        return LeafSet(low, high, tuple(holes))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LeafSet:
    """Tokens `low` to `high` (exclusive) except the holes: distinct, inside, or `OUTSIDE`."""

    low: Int32[Array, "*S"]
    high: Int32[Array, "*S"]
    holes: tuple[Int32[Array, "*S"], ...]

    def count(self) -> Int32[Array, "*S"]:
        return self.high - self.low - sum((hole < OUTSIDE).astype(jnp.int32) for hole in self.holes)

    def has(self, token: Int32[Array, "..."]) -> Bool[Array, "..."]:
        inside = (token >= self.low) & (token < self.high)
        for hole in self.holes:
            inside &= token != hole
        return inside

    def draw(self, word: UInt32[Array, "*S"]) -> Int32[Array, "*S"]:
        """Return a uniform token of the set, from a random word; meaningless where the set is empty."""
        token = self.low + scaled(word, self.count())
        holes = list(self.holes)
        for i in range(len(holes)):  # ascending, so that each step over a hole is final
            for j in range(i + 1, len(holes)):
                holes[i], holes[j] = jnp.minimum(holes[i], holes[j]), jnp.maximum(holes[i], holes[j])
            token += (token >= holes[i]).astype(jnp.int32)
        return token


def scaled(word: UInt32[Array, "*S"], count: Int32[Array, "*S"]) -> Int32[Array, "*S"]:
    """Return a random word as a uniform integer from 0 to count - 1 (0 where count is 0), at 24 bits."""
    fraction = (word >> 8).astype(jnp.float32) * jnp.float32(2**-24)
    return jnp.maximum(jnp.minimum((fraction * count.astype(jnp.float32)).astype(jnp.int32), count - 1), 0)
