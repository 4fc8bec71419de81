"""Removal of what an episode shows to do nothing, without another episode."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Iterable

import numpy as np
from jaxtyping import Int8, UInt8

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, Node
from bt_jax.encoding.arrays import Trees, violations
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import decorators, leaves, prefix, tidy
from bt_jax.gp.achievements.goals import FAILED, SUCCEEDED
from bt_jax.gp.achievements.nodes import TokenLeaf, encoded, nodes_of

__all__ = ["without_idle", "without_leaf"]

PASSED = {Kind.SEQUENCE: SUCCEEDED, Kind.FALLBACK: FAILED}  # the trace of a leaf after which its parent always went on
COUNTED = {Kind.RETRY: FAILED, Kind.TIMEOUT: 1 << Status.RUNNING}  # what decorators wait for


def without_idle(
    tree: Trees, trace: UInt8[np.ndarray, " N"], kinds: Int8[np.ndarray, " V"], *, gene_under_fallback: bool
) -> Trees:
    """Return a valid tree [N] without nodes that did nothing in the episodes of a trace; it is valid, too, and does exactly
    the same in them.

    A leaf that was never ticked does nothing, nor does one after which its parent always went on to the next child, unless
    it ran or had something noted. A decorator does nothing around what never returned what it counts. The last child of a
    control node stays, and so does what would leave a tree that breaks a rule.
    """

    def is_allowed(smaller: Node[TokenLeaf]) -> bool:
        return not violations(smaller, gene_under_fallback=gene_under_fallback)

    best = nodes_of(tree, kinds, trace)
    plain = tidy(_without_counters(best))
    if plain is not None and is_allowed(plain):
        best = plain
    while idle := list(_idle(best)):
        each = ([place] for place in idle)
        found = (_smaller(best, places) for places in itertools.chain([idle], each))
        smaller = next((other for other in found if other is not None and is_allowed(other)), None)
        if smaller is None or len(prefix(smaller)) == len(prefix(best)):
            break
        best = smaller
    return _as_arrays(best, tree, kinds)


def without_leaf(tree: Trees, place: int, kinds: Int8[np.ndarray, " V"]) -> Trees | None:
    """Return a tree [N] without the leaf at a place, tidied up; None if nothing is left."""
    found = _smaller(nodes_of(tree, kinds), [place])
    return None if found is None else _as_arrays(found, tree, kinds)


def _as_arrays(found: Node[TokenLeaf], tree: Trees, kinds: Int8[np.ndarray, " V"]) -> Trees:
    """Return a tree that is smaller than another as arrays of the same length."""
    smaller = encoded(found, tree.num_nodes, kinds)
    assert smaller is not None
    return smaller


def _without_counters(node: Node[TokenLeaf]) -> Node[TokenLeaf]:
    """Return a node without decorators that never had anything to count: no leaf below has returned it, nor could another
    decorator have done so."""
    if not isinstance(node, Control | ExtendedNode):
        return node
    below = tuple(map(_without_counters, node.children))
    own = COUNTED.get(node.decorator.kind) if isinstance(node, ExtendedNode) and node.decorator else None
    if own is not None and not decorators(below[0]) and not any(leaf.trace & own for leaf in leaves(below[0])):
        return below[0]
    return dataclasses.replace(node, children=below)


def _idle(node: Node[TokenLeaf]) -> Iterable[int]:
    """Yield the places of leaves that did nothing, the last first; a decorator of a single leaf returned SUCCESS whenever
    that did."""
    if isinstance(node, ExtendedNode):
        yield from _idle(node.children[0])
    if not isinstance(node, Control):
        return
    for child in reversed(node.children):
        leaf = _decorated(child)
        passed = PASSED[node.kind] if leaf is child else PASSED[node.kind] & SUCCEEDED
        if leaf is not None and leaf.trace in (0, passed):
            yield leaf.place
        yield from _idle(child)


def _decorated(node: Node[TokenLeaf]) -> TokenLeaf | None:
    """Return the leaf that a node is, or that it decorates; None if there is a control node."""
    while isinstance(node, ExtendedNode):
        node = node.children[0]
    return node if isinstance(node, TokenLeaf) else None


def _smaller(tree: Node[TokenLeaf], places: list[int]) -> Node[TokenLeaf] | None:
    """Return the tree without the leaves at these places, tidied up; None if nothing is left, or if tidying would take a
    decorator that counts."""
    found = _without(tree, frozenset(places))
    smaller = None if found is None else tidy(found)
    if found is None or smaller is None or len(decorators(smaller)) < len(decorators(found)):
        return None
    return smaller


def _without(node: Node[TokenLeaf], places: frozenset[int]) -> Node[TokenLeaf] | None:
    """Return a node without the leaves at these places. Where no child would be left, a leaf stays that was ticked; a node
    of which nothing was ticked goes, None."""
    if isinstance(node, TokenLeaf):
        return None if node.place in places else node
    assert isinstance(node, Control | ExtendedNode)
    kept = [found for child in node.children if (found := _without(child, places)) is not None]
    if not kept and isinstance(node, Control):
        kept += [child for child in node.children if (leaf := _decorated(child)) is not None and leaf.trace][:1]
    return dataclasses.replace(node, children=tuple(kept)) if kept else None
