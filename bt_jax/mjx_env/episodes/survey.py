"""One tree in many layouts, also a tree that arrays cannot hold."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np

from bt_jax.behaviors import Tree
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import decorators, extended_nodes, prefix
from bt_jax.mjx_env.episodes.evaluator import Evaluation, TableEvaluator
from bt_jax.mjx_env.episodes.fitness import subgoals_missed
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, take

__all__ = ["fits_arrays", "survey"]


def fits_arrays(tree: Tree) -> bool:
    """Return whether compiled code can tick a tree: one of nodes that arrays hold, and not too large."""
    return not extended_nodes(tree) and len(prefix(tree)) <= MAX_NODES


def survey(
    semantics: LeafSemantics, physics: Physics, tree: Tree, layouts: World, fates: Fates | None = None
) -> Evaluation:
    """Return the episodes of a tree in K layouts (NumPy), P = 1, each with its fate where things go wrong. Compiled code
    ticks the tree if it can, with the same result as plain Python."""
    if fits_arrays(tree):
        vocabulary = semantics.vocabulary.extended((), decorators(tree))  # the tokens of leaves stay
        semantics = dataclasses.replace(semantics, vocabulary=vocabulary)
        evaluator = TableEvaluator(semantics, physics, batch=1)
        return evaluator(encode_all([tree], vocabulary, MAX_NODES), layouts, fates=fates)
    settler, rows = Settler(semantics.task, physics), [slice(k, k + 1) for k in range(layouts.held.shape[0])]
    played = [play(semantics, settler, tree, take(layouts, row), None if fates is None else fates[row]) for row in rows]
    return Evaluation(
        values=np.array([[one.fitness for one in played]], np.float32),
        ending=np.array([[one.ending for one in played]], np.int8),
        ticks=np.array([[len(one.ticks) for one in played]], np.int32),
        misses=jax.tree.map(lambda *leaves: np.stack(leaves)[None], *(one.misses for one in played)),
        subgoals_missed=np.array([[subgoals_missed(one.final)[0] for one in played]], np.int32),
        solved=np.array([[one.solved for one in played]], bool),
        reached=np.array([[one.final.reached[0] for one in played]], bool),
        struck=None if fates is None else np.array([[one.struck for one in played]], np.int32),
        travel=None if layouts.base is None else np.array([[one.travel for one in played]], np.float32),
    )
