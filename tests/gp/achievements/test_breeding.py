"""Offspring keep what their parents achieve, as far as it fits."""

import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import FIRST_LEAF, Kind
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.breeding import Origin, built
from bt_jax.gp.achievements.compose import compose, leaf_parts
from bt_jax.gp.achievements.goals import Goals
from bt_jax.gp.achievements.knowledge import Knowledge

GROUPS, COUNT = 13, 32


@pytest.mark.parametrize(("num_nodes", "fits"), [(13, False), (14, True), (16, True), (64, True)])
@pytest.mark.parametrize("step", [False, True])
def test_a_tree_with_many_children_gets_what_it_lacks_and_loses_none(num_nodes, fits, step):
    """The last leaf meets the target, or is the step on the way, that a tree with all others lacks."""
    leaves = FIRST_LEAF + np.arange(GROUPS)
    group = np.array([-1] * FIRST_LEAF + list(range(GROUPS)), np.int32)
    concerns = np.arange(GROUPS, dtype=np.int32)
    if step:
        group[-1] = concerns[-1] = -1
    goals = Goals(group, concerns, np.zeros(GROUPS, np.int32))
    kinds = np.array([0, Kind.SEQUENCE, Kind.FALLBACK] + [Kind.GENE] * GROUPS, np.int8)
    knowledge = Knowledge.empty(goals, num_nodes)
    achieves = knowledge.linkage.achieves.copy()
    achieves[leaves, np.arange(GROUPS)] = 1
    knowledge = dataclasses.replace(knowledge, linkage=dataclasses.replace(knowledge.linkage, achieves=achieves))
    parents, _ = compose(leaf_parts(np.tile(leaves[:-1], (COUNT, 1)), num_nodes))
    achieved = np.ones((COUNT, GROUPS), bool)
    achieved[:, -1] = False
    missed = (1 - achieved).astype(np.float32)
    origin = np.full(COUNT, Origin.FILLED, np.int32)
    trees, made = built(np.random.default_rng(0), origin, parents, achieved, missed, knowledge, goals, kinds)
    assert isinstance(trees, Trees)
    assert made.all() == made.any() == fits
    if fits:
        assert (trees.sizes[:, 0] == 1 + GROUPS).all()
        assert (np.sort(trees.tokens[:, 1 : 1 + GROUPS], axis=1) == leaves).all()
