"""What evaluations tell of each leaf is what plain Python sees when it plays the same episode."""

import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Kind
from bt_jax.encoding.arrays import decode, encode_all
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.tick import NOTED
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.world import take
from tests.helpers.samples import assert_same, random_trees, semantics_of

NODES, COUNT, LAYOUTS = 24, 32, 2
SEMANTICS = semantics_of("restack")
UNSTACKS = (
    "Fallback(reached(unstacked), Sequence(move(GreenBox, (0.133, 0, 0.055), KittingBox),"
    " move(BlueBox, (-0.133, 0, 0.055), KittingBox)))"
)


@pytest.fixture(scope="module")
def trees():
    leaves = SEMANTICS.vocabulary.leaves
    reached = [leaf for leaf in leaves if leaf.name == "reached"]
    found = random_trees(7, [*leaves, *reached * 10], COUNT - 1, most_leaves=6)
    return encode_all([parse_tree(UNSTACKS), *found], SEMANTICS.vocabulary, NODES)


@pytest.fixture(scope="module")
def layouts():
    return sample_layouts(SEMANTICS.task, 3, LAYOUTS)


@pytest.fixture(scope="module")
def evaluated(trees, layouts):
    return TableEvaluator(SEMANTICS, Kinematic(SEMANTICS.task), batch=COUNT, trace=True)(trees, layouts)


def test_the_trace_holds_all_statuses_of_an_episode(trees, layouts, evaluated):
    settler = Settler(SEMANTICS.task, Kinematic(SEMANTICS.task))
    for i in range(COUNT):
        tree = decode(trees[i], SEMANTICS.vocabulary)
        for k in range(LAYOUTS):
            played = play(SEMANTICS, settler, tree, take(layouts, slice(k, k + 1)))
            seen = np.zeros(NODES, np.uint8)
            for tick in played.ticks:
                for node, status in enumerate(tick.statuses):
                    if status is not None and SEMANTICS.vocabulary.kinds[trees.tokens[i, node]] > 2:
                        seen[node] |= 1 << status
            np.testing.assert_array_equal(evaluated.trace[i, k] & ~np.uint8(NOTED), seen)


def test_a_leaf_that_reaches_a_subgoal_has_something_noted(trees, evaluated):
    reached = evaluated.reached[..., 0]
    token = next(SEMANTICS.vocabulary.token(leaf) for leaf in SEMANTICS.vocabulary.leaves if leaf.name == "reached")
    noted = ((evaluated.trace & NOTED > 0) & (trees.tokens == token)[:, None]).any(axis=-1)
    np.testing.assert_array_equal(noted, reached)
    assert reached.any()


def test_an_action_has_nothing_noted(trees, evaluated):
    conditions = np.isin(SEMANTICS.vocabulary.kinds[trees.tokens], [Kind.CONDITION])
    assert not (evaluated.trace & NOTED)[~np.repeat(conditions[:, None], LAYOUTS, axis=1)].any()


@pytest.mark.slow
def test_a_trace_changes_nothing_else_and_the_rollout_gives_the_same(trees, layouts, evaluated):
    kinematic = Kinematic(SEMANTICS.task)
    plain = TableEvaluator(SEMANTICS, kinematic, batch=COUNT)(trees, layouts)
    assert plain.trace is None
    assert_same(dataclasses.replace(evaluated, trace=None), plain)
    assert_same(evaluated, RolloutEvaluator(SEMANTICS, kinematic, batch=COUNT, trace=True)(trees, layouts))
