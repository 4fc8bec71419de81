"""Trees as py_trees objects, to be used in py_trees programs and as the oracle in tests."""

from __future__ import annotations

from collections.abc import Callable

from py_trees.behaviour import Behaviour
from py_trees.common import Status
from py_trees.composites import Selector, Sequence

from bt_jax.behaviors import Behavior, Kind, Tree, expand
from bt_jax.encoding.walk import children

__all__ = ["Leaf", "to_py_trees"]


class Leaf(Behaviour):
    """A condition, an action or a gene; its status comes from `status_of` whenever it is ticked."""

    def __init__(self, behavior: Behavior, status_of: Callable[[Behavior], Status]):
        super().__init__(name=behavior.label)
        self.behavior = behavior
        self.status_of = status_of

    def update(self) -> Status:
        return self.status_of(self.behavior)


def to_py_trees(
    tree: Tree, status_of: Callable[[Behavior], Status], *, expand_genes: bool = False
) -> Sequence | Selector | Leaf:
    """Return the tree with memoryless Sequence and Selector composites (our Fallback is py_trees' Selector).

    `status_of(behavior)` is called each time that a leaf is ticked and returns its status. A gene is one leaf, unless
    `expand_genes` puts its subtree in its place. `tick_once()` of the root ticks the tree.
    """
    if expand_genes:
        tree = expand(tree)
    if isinstance(tree, Behavior):
        return Leaf(tree, status_of)
    nodes = [to_py_trees(child, status_of) for child in children(tree)]
    if tree.kind == Kind.SEQUENCE:
        return Sequence(name="Sequence", memory=False, children=nodes)
    return Selector(name="Fallback", memory=False, children=nodes)
