"""Random trees to start from."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array

from bt_jax.behaviors.nodes import Kind
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import MutationConfig
from bt_jax.gp.mutation import EditRates, mutate_packed
from bt_jax.gp.rng import random_words
from bt_jax.gp.splice import SIZE_BIT, unpack

__all__ = ["growth", "random_trees"]


def growth(*, gene_under_fallback: bool) -> MutationConfig:
    """Return the mutations by which a tree grows."""
    return MutationConfig(add=1.0, delete=0.0, change=0.0, gene_under_fallback=gene_under_fallback)


def random_trees(
    key: Array,
    alphabet: Alphabet,
    *,
    rates: EditRates | None = None,
    count: int,
    num_nodes: int,
    nodes: int = 4,
    gene_under_fallback: bool = False,
) -> Trees:
    """`count` random valid trees of `nodes` nodes (3 at least, `num_nodes` at most), in arrays of length `num_nodes`.

    A control node with two children grows by random insertions, leaves and control nodes evenly, as far as they fit: the
    published trees (random nodes, half of them leaves, redrawn until valid) without the redrawing. A tree stays smaller
    where the alphabet admits no insertion. `rates`, those of `growth`, must be given where the alphabet is traced.
    """
    config = growth(gene_under_fallback=gene_under_fallback)
    rates = EditRates.of(alphabet, config) if rates is None else rates
    return _grown(key, alphabet, rates, config, count, num_nodes, nodes)


@partial(jax.jit, static_argnames=("config", "count", "num_nodes", "nodes"))
def _grown(
    key: Array,
    alphabet: Alphabet,
    rates: EditRates,
    config: MutationConfig,
    count: int,
    num_nodes: int,
    nodes: int,
) -> Trees:
    kind_key, leaf_key, grow_key = jax.random.split(key, 3)
    fallback = jax.random.bernoulli(kind_key, shape=(count,)) & (rates.pairs[1] > 0)
    kind = jnp.where(fallback, jnp.int32(Kind.FALLBACK), jnp.int32(Kind.SEQUENCE))
    words = random_words(leaf_key, (2, count))
    genes = (kind != Kind.FALLBACK) | config.gene_under_fallback
    yes = jnp.ones_like(genes)
    act = alphabet.leaves(conditions=~yes, acts=yes, genes=genes).draw(words[0])
    leaf = alphabet.leaves(act, conditions=yes, acts=yes, genes=genes).draw(words[1])
    one = 1 << SIZE_BIT
    packed = jnp.stack([kind | (3 << SIZE_BIT), leaf | one, act | one], axis=1)
    trees = jnp.pad(packed, ((0, 0), (0, num_nodes - 3)))

    def grow(i: Array, trees: Array) -> Array:
        return mutate_packed(grow_key, trees, alphabet, config, rates=rates, max_nodes=nodes, step=i)

    return unpack(jax.lax.fori_loop(0, nodes - 3, grow, trees))
