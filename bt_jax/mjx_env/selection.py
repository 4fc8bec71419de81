"""Which leaves of a vocabulary are computed together: those with the same skeleton, whose atoms stand in columns."""

from __future__ import annotations

import dataclasses

import numpy as np

from bt_jax.behaviors import FIRST_LEAF, Behavior, Control, ExtendedNode, Tree

__all__ = ["Selection", "atoms_of", "selection_of", "skeleton"]


@dataclasses.dataclass(frozen=True)
class Selection:
    """Some tokens of a vocabulary, control nodes among them, and what computes their outcomes."""

    tokens: np.ndarray  # int[m], ascending
    places: np.ndarray | slice  # of `LeafSemantics.places`, those that the leaves name
    spots: np.ndarray | slice  # of `LeafSemantics.spots`, likewise
    groups: list[tuple[Tree, np.ndarray]]  # leaves with the same skeleton: it, and columns of its atoms [atoms, leaves]
    order: np.ndarray  # where to find each token when the groups stand side by side behind the control nodes


def selection_of(
    places: np.ndarray | slice, spots: np.ndarray | slice, groups: list[tuple[np.ndarray, Tree, np.ndarray]]
) -> Selection:
    """Return what computes groups of leaves: of each its tokens, its skeleton and the columns of its atoms."""
    tokens = np.concatenate([np.arange(FIRST_LEAF), *(own for own, _, _ in groups)])
    order = np.argsort(tokens)
    return Selection(tokens[order], places, spots, [(body, columns) for _, body, columns in groups], order)


def atoms_of(leaf: Tree) -> list[Behavior]:
    """Return the conditions and actions of a leaf, in prefix order; those of its subtree for a gene."""
    if isinstance(leaf, Control | ExtendedNode):
        return [atom for child in leaf.children for atom in atoms_of(child)]
    return atoms_of(leaf.subtree) if leaf.subtree else [leaf]


def skeleton(node: Tree) -> str:
    """Return the form of a leaf: its nodes, with only the kinds of its conditions and actions."""
    if isinstance(node, Behavior):
        return skeleton(node.subtree) if node.subtree else node.kind.name
    name = node.kind.name if isinstance(node, Control) else node.name
    return f"{name}({','.join(skeleton(child) for child in node.children)})"
