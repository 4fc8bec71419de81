"""Trees put together from parts, many at once."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Int, Int32

from bt_jax.behaviors.nodes import Kind
from bt_jax.encoding.arrays import Trees

__all__ = ["children_of", "compose", "leaf_parts"]


def leaf_parts(leaves: Int[np.ndarray, "*M"], num_nodes: int) -> Trees:
    """Return single leaves as trees [*M, N]; token 0 is no tree."""
    tokens = np.zeros((*leaves.shape, num_nodes), np.int16)
    sizes = np.zeros(tokens.shape, np.uint8)
    tokens[..., 0] = leaves
    sizes[..., 0] = leaves > 0
    return Trees(tokens, sizes)


def children_of(trees: Trees) -> Trees:
    """Return what a Sequence of each of M trees [M, N] would hold, as parts [M, K, N]: the children of a Sequence, and
    anything else whole. K is as many as one of them has."""
    rows, here = np.arange(len(trees.tokens)), np.arange(trees.num_nodes)
    at = (trees.tokens[:, 0] == Kind.SEQUENCE).astype(np.int64)
    end = trees.sizes[:, 0].astype(np.int64)
    tokens: list[np.ndarray] = []
    sizes: list[np.ndarray] = []
    while (at < end).any() or not tokens:
        size = np.where(at < end, trees.sizes[rows, np.minimum(at, trees.num_nodes - 1)], 0).astype(np.int64)
        source = np.minimum(at[:, None] + here, trees.num_nodes - 1)
        inside = here < size[:, None]
        tokens.append(np.where(inside, trees.tokens[rows[:, None], source], 0))
        sizes.append(np.where(inside, trees.sizes[rows[:, None], source], 0))
        at = at + size
    return Trees(np.stack(tokens, axis=1), np.stack(sizes, axis=1))


def compose(parts: Trees, kind: Kind = Kind.SEQUENCE) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return control nodes of a kind over the parts [M, K, N], and which of them fit in N nodes.

    A part of the same kind gives its children, equal leaves in a row count once, and a single part stays as it is.
    """
    count, most, num_nodes = parts.tokens.shape
    lengths = np.asarray(parts.sizes[..., 0], np.int64)
    same = (parts.tokens[..., 0] == kind) & (lengths > 1)
    take = np.arange(num_nodes) < lengths[..., None]
    take[..., 0] &= ~same
    tokens, sizes = (field.reshape(count, most * num_nodes) for field in (parts.tokens, parts.sizes))
    take = take.reshape(count, most * num_nodes) & ~_repeats(parts, lengths).repeat(num_nodes, axis=1)
    place = np.cumsum(take, axis=1)  # behind the control node
    total = take.sum(axis=1)
    single = (total > 0) & (np.where(take, sizes, 0).max(axis=1, initial=0) == total)  # one part holds all
    fits = (total > 0) & (total + ~single <= num_nodes)
    keep = take & fits[:, None]
    row, source = np.nonzero(keep)
    place = place[row, source] - single[row]
    result = Trees(np.zeros((count, num_nodes), np.int16), np.zeros((count, num_nodes), np.uint8))
    result.tokens[row, place], result.sizes[row, place] = tokens[row, source], sizes[row, source]
    topped = fits & ~single
    result.tokens[topped, 0], result.sizes[topped, 0] = kind, total[topped] + 1
    return result, fits


def _repeats(parts: Trees, lengths: Int[np.ndarray, "M K"]) -> Bool[np.ndarray, "M K"]:
    """Return which parts are a leaf that equals the part before, parts of no nodes not counted."""
    repeats = np.zeros(lengths.shape, bool)
    last: Int32[np.ndarray, " M"] = np.zeros(len(lengths), np.int32)
    for k in range(lengths.shape[1]):
        leaf, present = lengths[:, k] == 1, lengths[:, k] > 0
        token = parts.tokens[:, k, 0].astype(np.int32)
        repeats[:, k] = leaf & (token == last)
        last = np.where(present, np.where(leaf, token, 0), last)
    return repeats
