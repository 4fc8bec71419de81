"""Trees as fixed-size integer arrays, in prefix order.

Legend of dimensions, here and in all of bt_jax:
  P population (trees)   N nodes (fixed length of a tree's arrays)   V vocabulary (tokens)
  E episodes   S states   C commands   B boxes   K layouts   R runs

`tokens[i]` is the token of node i and `sizes[i]` the number of nodes of its subtree; both are 0 where padded. The next
sibling of node i is `i + sizes[i]`; the ancestors of i are the j with `j < i < j + sizes[j]`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Int16, UInt8

from bt_jax._util.errors import UserError
from bt_jax.behaviors.nodes import EXTENDED, Control, ExtendedNode, Kind, L, Node
from bt_jax.behaviors.vocabulary import Vocabulary
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import children

__all__ = ["Array", "Trees", "decode", "encode", "encode_all", "length", "violations"]

Array = jax.Array | np.ndarray


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Trees:
    """A batch of trees (or one, without the leading dimensions)."""

    tokens: Int16[Array, "*P N"]
    sizes: UInt8[Array, "*P N"]

    def __getitem__(self, index: Any) -> Trees:
        return Trees(self.tokens[index], self.sizes[index])

    @property
    def num_nodes(self) -> int:
        """N, the fixed length of the arrays."""
        return self.tokens.shape[-1]


def length(trees: Trees) -> Array:
    """Return the number of nodes of each tree, uint8[*P]: the size of its root."""
    return trees.sizes[..., 0]


def encode(tree: Node[L], vocabulary: Vocabulary[L], num_nodes: int) -> Trees:
    """Return one tree as NumPy arrays of length `num_nodes`. Raise UserError if it does not fit, if a leaf is unknown, or if
    it has a node that arrays do not hold."""
    tokens: list[int] = []
    sizes: list[int] = []

    def visit(node: Node[L]) -> None:
        at = len(tokens)
        if isinstance(node, Control):
            tokens.append(int(node.kind))
        elif isinstance(node, ExtendedNode):
            if node.decorator is None:
                held = ", ".join(("Sequence", "Fallback", *DECORATORS.values()))
                raise UserError(f"arrays hold {held} and leaves, not {node.label}; tick the tree with tick_tree")
            tokens.append(vocabulary.token(node.decorator))
        else:
            tokens.append(vocabulary.token(node))
        sizes.append(0)
        for child in children(node):
            visit(child)
        sizes[at] = len(tokens) - at

    visit(tree)
    if len(tokens) > num_nodes:
        fits = len(tokens) <= MAX_NODES
        remedy = f"raise --max-nodes (at most {MAX_NODES})" if fits else f"give a tree of {MAX_NODES} nodes at most"
        raise UserError(
            f"the tree has {len(tokens)} nodes and {num_nodes} fit; {remedy}",
            code="too many nodes",
            nodes=len(tokens),
            room=num_nodes,
        )
    padding = [0] * (num_nodes - len(tokens))
    return Trees(np.array(tokens + padding, np.int16), np.array(sizes + padding, np.uint8))


def encode_all(trees: Sequence[Node[L]], vocabulary: Vocabulary[L], num_nodes: int) -> Trees:
    """Return several trees as one batch of NumPy arrays, [P, N]."""
    encoded = [encode(tree, vocabulary, num_nodes) for tree in trees]
    return Trees(np.stack([tree.tokens for tree in encoded]), np.stack([tree.sizes for tree in encoded]))


def decode(trees: Trees, vocabulary: Vocabulary[L]) -> Node[L]:
    """Return the tree that one pair of arrays [N] stands for."""
    tokens, sizes = np.asarray(trees.tokens), np.asarray(trees.sizes)

    def build(i: int) -> Node[L]:
        kind = Kind(vocabulary.kinds[tokens[i]])
        if kind in (Kind.CONDITION, Kind.ACTION, Kind.GENE):
            return vocabulary.leaf(int(tokens[i]))
        below: list[Node[L]] = []
        child, end = i + 1, i + int(sizes[i])
        while child < end:
            below.append(build(child))
            child += int(sizes[child])
        if kind in DECORATORS:
            return ExtendedNode(DECORATORS[kind], tuple(below), vocabulary.decorator(int(tokens[i])).number)
        return Control(kind, tuple(below))

    return build(0)


DECORATORS = {extended.kind: name for name, extended in EXTENDED.items() if extended.kind is not None}


def violations(tree: Node[L], *, gene_under_fallback: bool = True) -> list[str]:
    """Return which rules of a well-formed evolved tree are broken, in words; empty for a valid tree.

    The rules are those of the design: the tree is no single condition; control nodes have at least two children, none of
    its own kind; no identical leaves side by side; no condition last among siblings or directly after an action or gene.
    `gene_under_fallback=False` adds the published rule that a gene, itself a Fallback, is not a direct child of a Fallback.
    A decorator is a retry or a timeout, and its child neither a condition nor a decorator of its kind.
    """
    found: list[str] = []
    if not isinstance(tree, Control | ExtendedNode):
        return ["the tree is a single condition"] if tree.kind == Kind.CONDITION else []

    def decorates(node: ExtendedNode[L]) -> None:
        if node.decorator is None:
            found.append(f"{node.label} is none of Sequence, Fallback, retry and timeout")
            return
        (child,) = node.children
        if isinstance(child, Control):
            visit(child)
        elif isinstance(child, ExtendedNode):
            if child.name == node.name:
                found.append(f"{child.label} is directly under its own kind")
            decorates(child)
        elif child.kind == Kind.CONDITION:
            found.append(f"{node.label} decorates the condition {child}")

    def visit(node: Control[L]) -> None:
        if len(node.children) < 2:
            found.append(f"a {node.kind.name.title()} has {len(node.children)} children")
        for before, child in zip((None, *node.children), node.children, strict=False):
            if isinstance(child, Control):
                if child.kind == node.kind:
                    found.append(f"a {node.kind.name.title()} is directly under its own kind")
                visit(child)
                continue
            if isinstance(child, ExtendedNode):
                decorates(child)
                continue
            if child == before:
                found.append(f"{child} is beside an equal one")
            leaf_before = None if isinstance(before, Control | ExtendedNode) else before
            after_action = leaf_before is not None and leaf_before.kind in (Kind.ACTION, Kind.GENE)
            if child.kind == Kind.CONDITION and after_action:
                found.append(f"the condition {child} directly follows {before}")
            if child.kind == Kind.GENE and node.kind == Kind.FALLBACK and not gene_under_fallback:
                found.append(f"the gene {child} is directly under a Fallback")
        last = node.children[-1] if node.children else None
        if not isinstance(last, Control | ExtendedNode | None) and last.kind == Kind.CONDITION:
            found.append(f"the condition {last} is the last child")

    if isinstance(tree, ExtendedNode):
        decorates(tree)
    else:
        visit(tree)
    return found
