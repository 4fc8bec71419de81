"""How different the individuals of a population are: by fitness, and by the edits that lead from one tree to another."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float32, Int32

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.splice import pack

__all__ = ["edit_distance", "fitness_entropy", "mean_edit_distance"]


def fitness_entropy(fitness: Float32[Array, " P"]) -> Float32[Array, ""]:
    """Return the entropy of the distribution of fitness values, in nats: 0 where all are equal, log P where all differ."""
    ordered = jnp.sort(fitness)
    first, last = (jnp.searchsorted(ordered, fitness, side=side) for side in ("left", "right"))
    count = fitness.shape[0]
    return -jnp.mean(jnp.log((last - first).astype(jnp.float32) / count))


def edit_distance(a: Trees, b: Trees) -> Int32[Array, " P"]:
    """Return the edit distance of each of P pairs of trees (Levenshtein).

    It is the least number of nodes to insert, delete or change in the prefix sequence of one to get the other's. A node is
    its token; how subtrees nest counts only through the order.
    """
    left, right = (pack(trees) & 0xFFFF for trees in (a, b))
    left_length, right_length = (trees.sizes[:, 0].astype(jnp.int32) for trees in (a, b))
    columns = jnp.arange(right.shape[1] + 1, dtype=jnp.int32)[None]
    start = jnp.broadcast_to(columns, (right.shape[0], columns.shape[1]))

    def row(i: Array, previous: Array) -> Array:
        token = jax.lax.dynamic_slice_in_dim(left, i, 1, axis=1)
        changed = previous[:, :-1] + (token != right).astype(jnp.int32)
        reached = jnp.minimum(previous + 1, jnp.pad(changed, ((0, 0), (1, 0)), constant_values=1 << 20))
        current = jax.lax.cummin(reached - columns, axis=1) + columns
        return jnp.where((i < left_length)[:, None], current, previous)

    distances = jax.lax.fori_loop(0, jnp.max(left_length), row, start)
    return jnp.take_along_axis(distances, right_length[:, None], axis=1)[:, 0]


@partial(jax.jit, static_argnames="pairs")
def mean_edit_distance(key: Array, trees: Trees, *, pairs: int = 64) -> Float32[Array, ""]:
    """Return the mean edit distance, in nodes, over random pairs of different individuals of P >= 2 (with replacement)."""
    first_key, other_key = jax.random.split(key)
    count = trees.tokens.shape[0]
    first = jax.random.randint(first_key, (pairs,), 0, count)
    other = (first + jax.random.randint(other_key, (pairs,), 1, count)) % count
    return jnp.mean(edit_distance(trees[first], trees[other]).astype(jnp.float32))
