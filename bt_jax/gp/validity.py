"""The rules of a valid tree, for whole populations; `encoding.arrays.violations` says the same in words for one tree."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet

__all__ = ["is_valid"]


@partial(jax.jit, static_argnames=("gene_under_fallback",))
def is_valid(trees: Trees, alphabet: Alphabet, *, gene_under_fallback: bool = False) -> Bool[Array, " P"]:
    """Return whether each of P trees is well formed, as arrays (nested sizes, padding) and by every rule of the design.

    A single action or gene is valid, as in `violations`; the operators never make one.
    """
    num_nodes = trees.num_nodes
    here = jnp.arange(num_nodes, dtype=jnp.int32)[None]
    tokens, sizes = jnp.asarray(trees.tokens, jnp.int32), jnp.asarray(trees.sizes, jnp.int32)
    ends = here + sizes
    length = sizes[:, :1]
    control = (tokens == Kind.SEQUENCE) | (tokens == Kind.FALLBACK)

    # Parent, its end and its kind in one integer. Parents come before children, so the last one that covers a node stays.
    packed = here | (ends << 8) | (tokens << 17)

    def cover(i: Array, scope: Array) -> Array:
        column = jax.lax.dynamic_slice_in_dim(packed, i, 1, axis=1)
        return jnp.where((here > i) & (here < (column >> 8) & 511), column, scope)

    longest = jnp.minimum(jnp.max(length), num_nodes)
    scope = jax.lax.fori_loop(0, longest, cover, jnp.zeros_like(packed))
    parent, parent_end, parent_kind = scope & 255, (scope >> 8) & 511, scope >> 17

    def shifted(values: Array) -> Array:
        return jnp.pad(values, ((0, 0), (1, 0)))[:, :-1]

    inside = (here < length) & (here > 0)
    first, last = parent + 1 == here, ends == parent_end
    sibling_before = ~first & (shifted(parent) == parent)
    before = jnp.where(sibling_before, shifted(tokens), 0)
    condition = alphabet.is_condition(tokens)

    good = jnp.where(control, sizes >= 3, (sizes == 1) & (tokens >= FIRST_LEAF) & (tokens < alphabet.end))
    good &= (ends <= parent_end) & (parent_kind <= Kind.FALLBACK) & (tokens != parent_kind)
    good &= ~(first & last) & ~(condition & last)
    good &= ~(sibling_before & (before == tokens)) & ~(condition & alphabet.is_act(before))
    if not gene_under_fallback:
        good &= ~(alphabet.is_gene(tokens) & (parent_kind == Kind.FALLBACK))
    padding = (here >= length) & (tokens == 0) & (sizes == 0)
    root = control[:, 0] & (sizes[:, 0] >= 3) & (sizes[:, 0] <= num_nodes)
    leaf = alphabet.is_act(tokens[:, 0]) & (tokens[:, 0] < alphabet.end) & (sizes[:, 0] == 1)
    return (root | leaf) & jnp.all(jnp.where(inside, good, padding | (here == 0)), axis=1)
