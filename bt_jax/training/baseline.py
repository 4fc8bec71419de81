"""Trees that an evolution starts from."""

from __future__ import annotations

import dataclasses
import hashlib

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, ExtendedNode, Tree, not_reactive
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.walk import decorators
from bt_jax.gp.config import GPConfig

__all__ = ["evolvable"]


def evolvable(baseline: Tree, config: GPConfig) -> Tree:
    """Return a tree as evolution can hold it: each memoryless decorator is one leaf together with what is below it.

    Raise UserError if it breaks a rule of evolved trees, or has a node that depends on earlier ticks, other than retry and
    timeout with the method achievements.
    """
    if (node := not_reactive(baseline)) is not None:
        raise UserError(
            f"the baseline cannot be evolved: {node.label} depends on earlier ticks, which evolved trees do not; replace it "
            "by Sequences, Fallbacks, retry and timeout"
        )
    if config.method == "population" and (counting := decorators(baseline)):
        name = counting[0].kind.name.lower()
        raise UserError(
            f"the baseline cannot be evolved with the method population: it has a {name}; choose --method achievements, or "
            "replace it by its child"
        )
    tree = _frozen(baseline)
    broken = violations(tree, gene_under_fallback=config.gene_under_fallback)
    if broken:
        remedy = "allow it with --gene-under-fallback" if "directly under a Fallback" in broken[0] else "fix the tree"
        raise UserError(
            f"the baseline cannot be evolved: {broken[0]}; {remedy}", code="gene under fallback", problem=broken[0]
        )
    return tree


def _frozen(tree: Tree) -> Tree:
    if isinstance(tree, Behavior):
        return tree
    if isinstance(tree, ExtendedNode) and tree.decorator is None:
        name = f"{tree.name}_{hashlib.sha256(str(tree).encode()).hexdigest()[:8]}"  # equal trees are one leaf
        return Behavior("subtask", (name, tree))
    below = tuple(map(_frozen, tree.children))
    return dataclasses.replace(tree, children=below)
