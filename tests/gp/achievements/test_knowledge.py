"""What a run says that it knows: which targets no leaf meets."""

import dataclasses

import jax
import numpy as np
import pytest

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.compose import compose, leaf_parts
from bt_jax.gp.achievements.knowledge import Knowledge
from tests.helpers.tower import Tower

NODES = 8
TOWER = Tower(right=(9, 1))  # whose first block has no leaf for its place
GENES = [leaf for leaf in TOWER.vocabulary.leaves if "@" in leaf.name]


@pytest.mark.parametrize(("share", "beyond"), [(0.0, [0]), (0.8, []), (1.0, [])])
def test_a_target_is_out_of_reach_if_no_leaf_has_met_it_in_any_layout(share, beyond):
    """`share` is that of the layouts in which the last leaf of the first block meets its target."""
    tokens = [TOWER.vocabulary.token(leaf) for leaf in GENES]
    last = TOWER.places - 1
    trees, _ = compose(leaf_parts(np.array(tokens)[:, None], NODES))
    measured = jax.tree.map(lambda leaf: leaf[0], TOWER.measured(Trees(trees.tokens[None], trees.sizes[None])))
    measured = dataclasses.replace(measured, achieved=measured.achieved.copy())
    measured.achieved[last, 0] = share
    knowledge = Knowledge.empty(TOWER.goals, NODES)
    assert knowledge.out_of_reach(TOWER.goals).tolist() == []  # nothing was tried
    kinds = TOWER.vocabulary.kinds
    knowledge = knowledge.updated(trees, measured, TOWER.goals, kinds, gene_under_fallback=True)
    assert (knowledge.linkage.tested[tokens] > 0).all()
    assert [a for a in knowledge.out_of_reach(TOWER.goals).tolist() if a == 0] == beyond
