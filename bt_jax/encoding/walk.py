"""Walking trees of Python objects: prefix order, the children of a node."""

from __future__ import annotations

from bt_jax.behaviors.nodes import Control, ExtendedNode, L, Node

__all__ = ["children", "depth", "extended_nodes", "leaves", "prefix", "tidy"]


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


def extended_nodes(tree: Node[L]) -> list[ExtendedNode[L]]:
    """Return all nodes that arrays do not hold, in prefix order."""
    return [node for node in prefix(tree) if isinstance(node, ExtendedNode)]


def tidy(tree: Node[L]) -> Node[L] | None:
    """Return a tree of Sequences and Fallbacks without control nodes of one child, or under their own kind; None if it has
    no leaves."""
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
