"""The one primitive under all genetic operators: cut and insert at two places of each tree, as one gather."""

from __future__ import annotations

import dataclasses
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Int32

from bt_jax.encoding.arrays import Trees

__all__ = ["Cut", "materialize", "pack", "splice", "unpack"]

T = TypeVar("T")
NEVER = -(1 << 30)  # no value that `materialize` meets
SIZE_BIT = 16  # a node as one integer: the token below this bit, the size above


def pack(trees: Trees) -> Int32[Array, "P N"]:
    return jnp.asarray(trees.tokens, jnp.int32) | (jnp.asarray(trees.sizes, jnp.int32) << SIZE_BIT)


def unpack(nodes: Int32[Array, "P N"]) -> Trees:
    return Trees((nodes & 0xFFFF).astype(jnp.int16), (nodes >> SIZE_BIT).astype(jnp.uint8))


def materialize(values: T) -> T:
    """Return the same arrays of integers, computed before what follows.

    XLA fuses what is computed once a tree into the loops over its nodes, and so computes it N times; on a CPU it drops
    `jax.lax.optimization_barrier`. A loop stays whose number of rounds, 0, it cannot know, and that changes every value.
    """

    def double(state: tuple[Array, T]) -> tuple[Array, T]:
        return jnp.zeros_like(state[0]), jax.tree.map(lambda value: value + value, state[1])

    first = jax.tree.leaves(values)[0].reshape(-1)[0]
    return jax.lax.while_loop(lambda state: state[0] == NEVER, double, (first, values))[1]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Cut:
    """At node `at`, `inserted` nodes, the donor's from `start` on, replace `removed` nodes."""

    at: Int32[Array, " P"]
    removed: Int32[Array, " P"]
    inserted: Int32[Array, " P"]
    start: Int32[Array, " P"]


def splice(
    nodes: Int32[Array, "P N"],
    donor: Int32[Array, "P D"],
    first: Cut,
    second: Cut,
    *,
    anchor: Int32[Array, " P"],
    growth: Int32[Array, " P"],
) -> Int32[Array, "P N"]:
    """Return packed trees after both cuts; `second` lies behind what `first` removes.

    The sizes of the anchor node and of its ancestors grow by `growth`; the result must fit.
    """
    num_nodes = nodes.shape[1]
    donor, first, second, anchor, growth = materialize((donor, first, second, anchor, growth))
    here = jnp.arange(num_nodes, dtype=jnp.int32)[None]
    sizes = nodes >> SIZE_BIT
    anchor, growth = anchor[:, None], growth[:, None]
    around = (here <= anchor) & (anchor < here + sizes)
    length = sizes[:, :1] + (first.inserted - first.removed + second.inserted - second.removed)[:, None]
    nodes = nodes + jnp.where(around, growth << SIZE_BIT, 0)

    shift = (first.removed - first.inserted)[:, None]
    first_end = (first.at + first.inserted)[:, None]
    second_at = second.at[:, None] - shift
    second_end = second_at + second.inserted[:, None]
    source = here + shift + (second.removed - second.inserted)[:, None]
    source = jnp.where(here < second_end, here - second_at + (num_nodes + second.start)[:, None], source)
    source = jnp.where(here < second_at, here + shift, source)
    source = jnp.where(here < first_end, here + (num_nodes + first.start - first.at)[:, None], source)
    source = jnp.where(here < first.at[:, None], here, source)

    both, source = materialize(
        (jnp.concatenate([nodes, donor], axis=1), jnp.clip(source, 0, num_nodes + donor.shape[1] - 1))
    )
    result = jnp.take_along_axis(both, source, axis=1, mode="promise_in_bounds")
    return jnp.where(here < length, result, 0)
