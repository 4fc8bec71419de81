"""Walking trees of Python objects: prefix order, the children of a node."""

from __future__ import annotations

import dataclasses

from bt_jax.behaviors.nodes import Control, Decorator, ExtendedNode, Kind, L, Node

__all__ = ["children", "decorators", "depth", "extended_nodes", "leaves", "prefix", "tidy"]


def children(tree: Node[L]) -> tuple[Node[L], ...]:
    """Return the children of a node from left to right; none for a leaf."""
    return tree.children if isinstance(tree, Control | ExtendedNode) else ()


def prefix(tree: Node[L]) -> list[Node[L]]:
    """Return all nodes in prefix order; a node's index in this list is its index everywhere, also in the array encoding."""
    nodes = [tree]
    for child in children(tree):
        nodes += prefix(child)
    return nodes


def depth(tree: Node[L]) -> int:
    """Return the number of nodes on the longest path from the root to a leaf."""
    return 1 + max(map(depth, children(tree)), default=0)


def leaves(tree: Node[L]) -> list[L]:
    """Return all leaves from left to right."""
    return [node for node in prefix(tree) if not isinstance(node, Control | ExtendedNode)]


def decorators(tree: Node[L]) -> list[Decorator]:
    """Return the decorators that arrays hold, in prefix order."""
    found = [node.decorator for node in prefix(tree) if isinstance(node, ExtendedNode)]
    return [decorator for decorator in found if decorator is not None]


def extended_nodes(tree: Node[L]) -> list[ExtendedNode[L]]:
    """Return all nodes that arrays do not hold, in prefix order."""
    return [node for node in prefix(tree) if isinstance(node, ExtendedNode) and node.decorator is None]


def tidy(tree: Node[L]) -> Node[L] | None:
    """Return a tree that arrays hold without control nodes of one child, or under their own kind, and without decorators
    of a condition, or under their own kind; None if it has no leaves."""
    if isinstance(tree, ExtendedNode):
        below = tidy(tree.children[0])
        own = tree.meaning.kind
        needless = isinstance(below, ExtendedNode) and below.meaning.kind == own
        is_condition = not isinstance(below, Control | ExtendedNode | None) and below.kind == Kind.CONDITION
        return below if below is None or needless or is_condition else dataclasses.replace(tree, children=(below,))
    if not isinstance(tree, Control):
        return tree
    flat: list[Node[L]] = []
    for child in [tidy(child) for child in tree.children]:
        if isinstance(child, Control) and child.kind == tree.kind:
            flat += child.children
        elif child is not None:
            flat.append(child)
    if not flat:
        return None
    return flat[0] if len(flat) == 1 else Control(tree.kind, tuple(flat))
