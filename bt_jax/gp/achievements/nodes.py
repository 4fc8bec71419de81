"""Single trees of tokens as nodes of Python, for edits that are rare enough."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Int8, UInt8

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, Node
from bt_jax.encoding.arrays import DECORATORS, Trees
from bt_jax.encoding.walk import prefix

__all__ = ["TokenLeaf", "encoded", "first_decorator", "nodes_of"]


@dataclasses.dataclass(frozen=True)
class TokenLeaf:
    """A leaf at a place of a tree; leaves of one token are equal."""

    token: int
    kind: Kind
    place: int = dataclasses.field(default=-1, compare=False)  # -1 for one that is new
    trace: int = dataclasses.field(default=0, compare=False)

    @property
    def label(self) -> str:
        return str(self.token)


def first_decorator(kinds: Int8[np.ndarray, " V"]) -> int:
    """Return the first token of a decorator; V, where there are none."""
    return int(np.searchsorted(kinds, Kind.RETRY))


def nodes_of(
    tree: Trees, kinds: Int8[np.ndarray, " V"], trace: UInt8[np.ndarray, " N"] | None = None
) -> Node[TokenLeaf]:
    """Return a tree [N] as nodes. The number of a decorator says which of all decorators it is, counted from 1."""
    tokens, sizes = tree.tokens.tolist(), tree.sizes.tolist()
    returned = [0] * len(tokens) if trace is None else trace.tolist()
    before = first_decorator(kinds) - 1

    def build(at: int) -> Node[TokenLeaf]:
        kind = Kind(int(kinds[tokens[at]]))
        if kind in DECORATORS:
            return ExtendedNode(DECORATORS[kind], (build(at + 1),), tokens[at] - before)
        if kind not in (Kind.SEQUENCE, Kind.FALLBACK):
            return TokenLeaf(tokens[at], kind, at, returned[at])
        children, child = [], at + 1
        while child < at + sizes[at]:
            children.append(build(child))
            child += sizes[child]
        return Control(kind, tuple(children))

    return build(0)


def encoded(tree: Node[TokenLeaf], num_nodes: int, kinds: Int8[np.ndarray, " V"]) -> Trees | None:
    """Return a tree as arrays [N]; None if it does not fit."""
    nodes = prefix(tree)
    if len(nodes) > num_nodes:
        return None
    tokens, sizes = np.zeros(num_nodes, np.int16), np.zeros(num_nodes, np.uint8)
    before = first_decorator(kinds) - 1
    for at, node in enumerate(nodes):
        match node:
            case Control():
                tokens[at] = node.kind
            case ExtendedNode():
                assert node.number is not None
                tokens[at] = before + node.number
            case _:
                tokens[at] = node.token
        sizes[at] = len(prefix(node))
    return Trees(tokens, sizes)
