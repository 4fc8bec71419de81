"""Removal of what does nothing from a learnt tree."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Control, ExtendedNode, Tree, Vocabulary
from bt_jax.encoding.arrays import encode_all, violations
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import decorators, extended_nodes, leaves, prefix, tidy
from bt_jax.mjx_env.episodes.evaluator import Evaluation, TableEvaluator
from bt_jax.mjx_env.episodes.survey import fits_arrays
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World
from bt_jax.tasks import Task

__all__ = ["Simplification", "simplify", "smaller_trees"]

BATCH = 16  # trees evaluated together, so that trees of all sizes share compiled code
SAME = 0.05  # fitness that counts as no change: 0.05 mm, below what the scene's states resolve


@dataclasses.dataclass(frozen=True)
class Simplification:
    """The tree without what does nothing, and how many nodes went; both do the same in the layouts tried."""

    tree: Tree
    removed: int


def smaller_trees(tree: Tree) -> list[Tree]:
    """Return all trees with one removal that break no rule which the tree keeps, the smallest first.

    A node with its subtree is removed, or a control node or decorator is replaced by one of its children. A control node
    left with one child dissolves, as does one under its own kind.
    """
    found = dict.fromkeys(tidy(other) for other in _removals(tree))
    loose = bool(violations(tree, gene_under_fallback=False))
    valid = [other for other in found if other is not None and not violations(other, gene_under_fallback=loose)]
    return sorted(valid, key=lambda other: len(prefix(other)))


def simplify(task: Task, physics: Physics, tree: Tree, layouts: World, fates: Fates | None = None) -> Simplification:
    """Remove whatever changes neither the fitness, apart from the cost of nodes, nor success in any of K layouts, each with
    its fate where things go wrong.

    All single removals are tried in one batch, the smallest tree that is as good stays, until none is. Raise UserError if
    the tree is too large, or has nodes that arrays do not hold.
    """
    if not fits_arrays(tree):
        extended = extended_nodes(tree)
        found = extended[0].label if extended else f"{len(prefix(tree))} nodes"
        raise UserError(
            f"the tree cannot be simplified, it has {found}; give a tree of Sequence, Fallback, retry and timeout, "
            f"{MAX_NODES} nodes at most"
        )
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree), decorators(tree)))
    evaluator = TableEvaluator(semantics, physics, batch=BATCH)

    def tried(trees: list[Tree]) -> Evaluation:
        return evaluator(encode_all(trees, semantics.vocabulary, MAX_NODES), layouts, fates=fates)

    known = tried([tree])
    best, solved = tree, known.solved[0]
    value = known.values[0] + _node_costs(task, tree)
    while candidates := smaller_trees(best):
        results = tried(candidates)
        as_good = (
            i
            for i, other in enumerate(candidates)
            if (results.solved[i] >= solved).all()
            and (results.values[i] + _node_costs(task, other) >= value - SAME).all()
        )
        if (first := next(as_good, None)) is None:
            break
        best = candidates[first]
    return Simplification(best, len(prefix(tree)) - len(prefix(best)))


def _node_costs(task: Task, tree: Tree) -> float:
    return task.weights.node * len(prefix(tree))


def _removals(tree: Tree) -> Iterator[Tree]:
    """Yield the tree with one removal; a control node may be left with a single child, or with none of its own."""
    if isinstance(tree, ExtendedNode):
        yield from tree.children
        for other in _removals(tree.children[0]):
            if not isinstance(other, Control) or other.children:
                yield dataclasses.replace(tree, children=(other,))
    if not isinstance(tree, Control):
        return
    yield from tree.children
    for i, child in enumerate(tree.children):
        rest = (tree.children[:i], tree.children[i + 1 :])
        yield Control(tree.kind, (*rest[0], *rest[1]))
        for other in _removals(child):
            yield Control(tree.kind, (*rest[0], other, *rest[1]))
