"""Crossover: subtrees travel between two trees, always to where they are valid."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32, UInt32

from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet, LeafSet, scaled
from bt_jax.gp.mutation import NODES_DRAWN, draw_nodes
from bt_jax.gp.rng import random_words
from bt_jax.gp.sites import OTHER, describe_sites
from bt_jax.gp.splice import SIZE_BIT, Cut, pack, splice, unpack

__all__ = ["crossover"]

WORDS = 1 + NODES_DRAWN  # random words a tree


def crossover(
    key: Array,
    a: Trees,
    b: Trees,
    alphabet: Alphabet,
    *,
    gene_under_fallback: bool = False,
    swap: bool = False,
    baseline: Bool[Array, "2 P"] | None = None,
    baseline_index: int | None = None,
) -> tuple[Trees, Trees]:
    """Return two offspring of each of P pairs: the first grows from `a`, the second from `b`.

    A random proper subtree of each (a lone leaf is taken whole) is inserted at a random place of the other (published), or
    takes the place of the other's subtree (`swap`). A few subtrees and places are drawn, and one pair that fits is chosen
    evenly; where none fits the tree is returned unchanged. Where `baseline` says that `a` (row 0) or `b` (row 1) is the
    baseline and `baseline_index` is given, that tree or a subtree of it becomes the child of that index of the other's
    root, or its last child where there are fewer.
    """
    count, num_nodes = a.tokens.shape
    own = jnp.concatenate([pack(a), pack(b)])
    words = random_words(key, (WORDS, 2 * count))
    node_words = words[1:].reshape(2, -1, 2 * count)
    length = own[:, 0] >> SIZE_BIT
    proper = jnp.where(length[:, None] > 1, 1 + draw_nodes(node_words[0], length - 1), 0)

    at = proper if swap else draw_nodes(node_words[1], length)
    forced = jnp.zeros(2 * count, bool)
    if baseline is not None and baseline_index is not None:
        forced = baseline[::-1].reshape(-1)
        proper = proper.at[:, 0].set(jnp.where(baseline.reshape(-1), 0, proper[:, 0]))
        at = jnp.where(forced[:, None], _child_of_root(own, baseline_index)[:, None], at)
    places = describe_sites(own, at, alphabet, gene_under_fallback=gene_under_fallback)
    other = jnp.roll(own, count, axis=0)
    gift = jnp.roll(proper, count, axis=0)
    gift_node = jnp.take_along_axis(other, gift, axis=1, mode="promise_in_bounds")
    gift_token, gift_size = gift_node & 0xFFFF, gift_node >> SIZE_BIT

    def over_places(field: Array) -> Array:
        return field[:, None]

    place = jax.tree.map(over_places, places)
    token, size = gift_token[:, :, None], gift_size[:, :, None]
    replaced = place.size if swap else 0
    fits = place.length - replaced + size <= num_nodes

    def allowed(leaves: LeafSet, control: Array) -> Array:
        return fits & jnp.where(token < FIRST_LEAF, token == control, leaves.has(token))

    if swap:
        options = allowed(place.instead(alphabet, gene_under_fallback=gene_under_fallback), place.control)
        joint = options[:count] & options[count:].swapaxes(1, 2)
        (gift_of_a, place_of_a), possible = _choose(joint, words[0, :count])
        chosen_gift, chosen = jnp.concatenate([gift_of_a, place_of_a]), jnp.concatenate([place_of_a, gift_of_a])
        possible, appends = jnp.tile(possible, 2), jnp.zeros(2 * count, bool)
    else:
        before = allowed(place.before(alphabet, gene_under_fallback=gene_under_fallback), place.control)
        behind = allowed(place.behind(alphabet, gene_under_fallback=gene_under_fallback), OTHER - place.token)
        behind &= ~place.is_leaf & (~forced[:, None, None] | place.is_root)
        (chosen_gift, chosen, side), possible = _choose(jnp.stack([before & ~place.is_root, behind], 3), words[0])
        appends = side == 1

    def take(field: Array, index: Array) -> Array:
        return jnp.take_along_axis(field, index[:, None], axis=1, mode="promise_in_bounds")[:, 0]

    slot = jax.tree.map(lambda field: take(field, chosen), places)
    none = jnp.zeros_like(slot.node)
    inserted = jnp.where(possible, take(gift_size, chosen_gift), 0)
    removed = jnp.where(possible, slot.size, 0) if swap else none
    result = splice(
        own,
        other,
        Cut(jnp.where(appends, slot.end, slot.node), removed, inserted, take(gift, chosen_gift)),
        Cut(none, none, none, none),
        anchor=jnp.where(appends, slot.node, slot.parent),
        growth=inserted - removed,
    )
    return unpack(result[:count]), unpack(result[count:])


def _choose(
    options: Bool[Array, " P *W"], word: UInt32[Array, " P"]
) -> tuple[tuple[Int32[Array, " P"], ...], Bool[Array, " P"]]:
    """Return one of the true options of each row, evenly, as its indices (0 if there is none), and whether there is any."""
    flat = jnp.cumsum(options.reshape(options.shape[0], -1).astype(jnp.int32), axis=1)
    count = flat[:, -1]
    index = jnp.sum((flat <= scaled(word, count)[:, None]).astype(jnp.int32), axis=1)
    return jnp.unravel_index(jnp.where(count > 0, index, 0), options.shape[1:]), count > 0


def _child_of_root(nodes: Int32[Array, "P N"], index: int) -> Int32[Array, " P"]:
    """Return the child of that index of each root; 0, the root itself, where there are fewer children."""
    length = nodes[:, 0] >> SIZE_BIT

    def step(_: Array, child: Array) -> Array:
        at = jnp.minimum(child, nodes.shape[1] - 1)[:, None]
        size = jnp.take_along_axis(nodes, at, axis=1, mode="promise_in_bounds")[:, 0] >> SIZE_BIT
        return jnp.minimum(child + size, length)

    child = jax.lax.fori_loop(0, index, step, jnp.ones_like(length))
    return jnp.where(child < length, child, 0)
