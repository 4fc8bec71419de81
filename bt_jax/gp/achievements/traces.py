"""Removal of what an episode shows to do nothing, without another episode."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable

import numpy as np
from jaxtyping import Int8, UInt8

from bt_jax.behaviors.nodes import Control, Kind, Node
from bt_jax.encoding.arrays import Trees, violations
from bt_jax.encoding.walk import prefix, tidy
from bt_jax.gp.achievements.goals import FAILED, SUCCEEDED

__all__ = ["without_idle", "without_leaf"]

PASSED = {Kind.SEQUENCE: SUCCEEDED, Kind.FALLBACK: FAILED}  # the trace of a leaf after which its parent always went on


@dataclasses.dataclass(frozen=True)
class _Leaf:
    """A leaf at a place of a tree; leaves of one token are equal."""

    token: int
    kind: Kind
    place: int = dataclasses.field(compare=False)
    trace: int = dataclasses.field(compare=False)

    @property
    def label(self) -> str:
        return str(self.token)


def without_idle(
    tree: Trees, trace: UInt8[np.ndarray, " N"], kinds: Int8[np.ndarray, " V"], *, gene_under_fallback: bool
) -> Trees:
    """Return a valid tree [N] without leaves that did nothing in the episodes of a trace; it is valid, too, and does exactly
    the same in them.

    A leaf that was never ticked does nothing, nor does one after which its parent always went on to the next child, unless
    it ran or had something noted. The last child of a control node stays, and so does what would leave a tree that breaks a
    rule.
    """
    best = _decoded(tree, trace, kinds)
    while idle := list(_idle(best)):
        each = ([place] for place in idle)
        found = (
            _smaller(best, places, gene_under_fallback=gene_under_fallback) for places in itertools.chain([idle], each)
        )
        smaller = next((other for other in found if other is not None), None)
        if smaller is None or len(prefix(smaller)) == len(prefix(best)):
            break
        best = smaller
    return _encoded(best, tree.num_nodes)


def without_leaf(tree: Trees, place: int, kinds: Int8[np.ndarray, " V"]) -> Trees | None:
    """Return a tree [N] without the leaf at a place, tidied up; None if nothing is left."""
    found = tidy(_without(_decoded(tree, np.zeros(tree.num_nodes, np.uint8), kinds), frozenset([place])))
    return None if found is None else _encoded(found, tree.num_nodes)


def _idle(node: Node[_Leaf]) -> Iterable[int]:
    """Yield the places of leaves that did nothing, the last first."""
    if not isinstance(node, Control):
        return
    for child in reversed(node.children):
        if isinstance(child, _Leaf) and child.trace in (0, PASSED[node.kind]):
            yield child.place
        yield from _idle(child)


def _smaller(tree: Node[_Leaf], places: list[int], *, gene_under_fallback: bool) -> Node[_Leaf] | None:
    """Return the tree without the leaves at these places; None if that breaks a rule."""
    found = tidy(_without(tree, frozenset(places)))
    if found is None or violations(found, gene_under_fallback=gene_under_fallback):
        return None
    return found


def _without(node: Node[_Leaf], places: frozenset[int]) -> Node[_Leaf]:
    """Return a node without the leaves at these places. Where no child would be left, one stays that was ticked; a node of
    which nothing was ticked goes."""
    if not isinstance(node, Control):
        return node
    children = [_without(child, places) for child in node.children]
    kept = [
        child
        for child in children
        if not (isinstance(child, _Leaf) and child.place in places)
        and not (isinstance(child, Control) and not child.children)
    ]
    if not kept:
        kept += [child for child in children if isinstance(child, _Leaf) and child.trace][:1]
    return dataclasses.replace(node, children=tuple(kept))


def _decoded(tree: Trees, trace: UInt8[np.ndarray, " N"], kinds: Int8[np.ndarray, " V"]) -> Node[_Leaf]:
    tokens, sizes = tree.tokens.tolist(), tree.sizes.tolist()

    def build(at: int) -> Node[_Leaf]:
        kind = Kind(int(kinds[tokens[at]]))
        if kind not in PASSED:
            return _Leaf(tokens[at], kind, at, int(trace[at]))
        children, child = [], at + 1
        while child < at + sizes[at]:
            children.append(build(child))
            child += sizes[child]
        return Control(kind, tuple(children))

    return build(0)


def _encoded(tree: Node[_Leaf], num_nodes: int) -> Trees:
    nodes = prefix(tree)
    tokens, sizes = np.zeros(num_nodes, np.int16), np.zeros(num_nodes, np.uint8)
    for at, node in enumerate(nodes):
        assert isinstance(node, _Leaf | Control)
        tokens[at] = node.kind if isinstance(node, Control) else node.token
        sizes[at] = len(prefix(node))
    return Trees(tokens, sizes)
