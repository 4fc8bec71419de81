"""Decorators apart from the trees that they stand in.

Genetic operators work on bare trees, of control nodes and leaves; the offspring get the decorators of their parents back.
What evolves besides is where decorators stand, and which leaves come before those that fail.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float32, Int8, Int32

from bt_jax.behaviors.nodes import Control, ExtendedNode, Kind, Node
from bt_jax.encoding.arrays import DECORATORS, Trees, violations
from bt_jax.encoding.walk import prefix, tidy
from bt_jax.gp.achievements.nodes import TokenLeaf, encoded, first_decorator, nodes_of

__all__ = ["Decoration", "bare", "decorated", "decoration_of", "hardened"]

ROOT = 0.3  # of the trees that get a decorator get it around the whole tree
ADDED, CHANGED, REMOVED = 0.5, 0.15, 0.15  # of hardened trees; the rest gets a leaf before one that fails
EVEN = 0.05  # share of failures that a leaf counts with that never failed

Wrap = tuple[str, int]  # name and number of a decorator


@dataclasses.dataclass(frozen=True)
class Decoration:
    """The decorators of a tree, from the outside in: those around the whole tree, and those around each bare subtree."""

    root: tuple[Wrap, ...] = ()
    around: Mapping[Node[TokenLeaf], tuple[Wrap, ...]] = dataclasses.field(default_factory=dict)


def bare(tree: Trees, kinds: Int8[np.ndarray, " V"]) -> Trees:
    """Return a tree [N] without its decorators."""
    if tree.tokens.max() < first_decorator(kinds):
        return tree
    found = encoded(_bare(nodes_of(tree, kinds)), tree.num_nodes, kinds)
    assert found is not None
    return found


def _bare(node: Node[TokenLeaf]) -> Node[TokenLeaf]:
    def plain(node: Node[TokenLeaf]) -> Node[TokenLeaf]:
        if isinstance(node, ExtendedNode):
            return plain(node.children[0])
        if isinstance(node, Control):
            return dataclasses.replace(node, children=tuple(map(plain, node.children)))
        return node

    found = tidy(plain(node))
    assert found is not None
    return found


def decoration_of(tree: Trees, kinds: Int8[np.ndarray, " V"]) -> Decoration:
    """Return the decorators of a tree [N]."""
    if tree.tokens.max() < first_decorator(kinds):
        return Decoration()
    root, below = _unwrapped(nodes_of(tree, kinds))
    around: dict[Node[TokenLeaf], tuple[Wrap, ...]] = {}

    def visit(node: Node[TokenLeaf]) -> None:
        wraps, inside = _unwrapped(node)
        if wraps:
            around[_bare(inside)] = wraps
        if isinstance(inside, Control):
            for child in inside.children:
                visit(child)

    visit(below)
    return Decoration(root, around)


def _unwrapped(node: Node[TokenLeaf]) -> tuple[tuple[Wrap, ...], Node[TokenLeaf]]:
    wraps: tuple[Wrap, ...] = ()
    while isinstance(node, ExtendedNode):
        assert node.number is not None
        wraps, node = (*wraps, (node.name, node.number)), node.children[0]
    return wraps, node


def _wrapped(node: Node[TokenLeaf], wraps: tuple[Wrap, ...]) -> Node[TokenLeaf]:
    for name, number in reversed(wraps):
        node = ExtendedNode(name, (node,), number)
    return node


def decorated(tree: Trees, decoration: Decoration, kinds: Int8[np.ndarray, " V"]) -> Trees:
    """Return a bare tree [N] with decorators around what they stood around, as far as it has that, and as they are if it has
    no room for them."""
    if not decoration.root and not decoration.around:
        return tree

    def dress(node: Node[TokenLeaf]) -> Node[TokenLeaf]:
        result = node
        if isinstance(node, Control):
            result = dataclasses.replace(node, children=tuple(map(dress, node.children)))
        return _wrapped(result, decoration.around.get(node, ()))

    root = nodes_of(tree, kinds)
    below = dataclasses.replace(root, children=tuple(map(dress, root.children))) if isinstance(root, Control) else root
    return encoded(_wrapped(below, decoration.root), tree.num_nodes, kinds) or tree


def hardened(
    rng: np.random.Generator,
    tree: Trees,
    failing: Float32[np.ndarray, " V"],
    before: Int32[np.ndarray, "V H"],
    kinds: Int8[np.ndarray, " V"],
    *,
    gene_under_fallback: bool,
) -> Trees | None:
    """Return a valid tree [N] with another decorator, without one, with one that counts further or less far, or with a leaf
    in front of one that fails; None if what was drawn cannot be done.

    `failing` says how often each leaf has failed, in proportion to which decorators and leaves are put there; `before` are
    the leaves that may stand in front of each, 0 for none.
    """
    root, first = nodes_of(tree, kinds), first_decorator(kinds)
    nodes = prefix(root)
    wraps = [i for i, node in enumerate(nodes) if isinstance(node, ExtendedNode)]
    draw = rng.random()
    number = int(rng.integers(1, len(kinds) - first + 1))
    name = DECORATORS[Kind(int(kinds[first - 1 + number]))]
    if draw < ADDED:
        at = 0 if rng.random() < ROOT else _place(rng, nodes, failing)
        new: Node[TokenLeaf] = ExtendedNode(name, (nodes[at],), number)
    elif draw < ADDED + CHANGED + REMOVED:
        if not wraps:
            return None
        at = wraps[rng.integers(len(wraps))]
        (below,) = nodes[at].children  # type: ignore[union-attr]  # a decorator
        new = ExtendedNode(name, (below,), number) if draw < ADDED + CHANGED else below
    else:
        places = [i for i, node in enumerate(nodes) if isinstance(node, TokenLeaf) and before[node.token].any()]
        if not places:
            return None
        at = _drawn(rng, places, nodes, failing)
        leaf = nodes[at]
        assert isinstance(leaf, TokenLeaf)
        choices = before[leaf.token][before[leaf.token] > 0]
        token = int(choices[rng.integers(len(choices))])
        new = Control.sequence(TokenLeaf(token, Kind(int(kinds[token]))), leaf)
    found = tidy(_replaced(root, at, new))
    if found is None or violations(found, gene_under_fallback=gene_under_fallback):
        return None
    return encoded(found, tree.num_nodes, kinds)


def _place(rng: np.random.Generator, nodes: list[Node[TokenLeaf]], failing: Float32[np.ndarray, " V"]) -> int:
    """Draw a leaf that acts, in proportion to how often it has failed, or as often a node around it."""
    places = [i for i, node in enumerate(nodes) if isinstance(node, TokenLeaf) and node.kind != Kind.CONDITION]
    at = _drawn(rng, places, nodes, failing)
    around = [i for i in range(at + 1) if at < i + len(prefix(nodes[i]))]
    return at if rng.random() < 0.5 else around[rng.integers(len(around))]


def _drawn(
    rng: np.random.Generator, places: list[int], nodes: list[Node[TokenLeaf]], failing: Float32[np.ndarray, " V"]
) -> int:
    tokens = [node.token for node in (nodes[i] for i in places) if isinstance(node, TokenLeaf)]
    weights = failing[tokens].astype(np.float64) + EVEN
    return int(rng.choice(places, p=weights / weights.sum()))


def _replaced(node: Node[TokenLeaf], at: int, new: Node[TokenLeaf]) -> Node[TokenLeaf]:
    """Return a tree with another node at a place, counted in prefix order."""
    if at == 0:
        return new
    assert isinstance(node, Control | ExtendedNode)
    children, begin = list(node.children), 1
    for i, child in enumerate(children):
        size = len(prefix(child))
        if begin <= at < begin + size:
            children[i] = _replaced(child, at - begin, new)
            break
        begin += size
    return dataclasses.replace(node, children=tuple(children))
