"""What driving costs: metres are counted alike wherever an episode runs, and priced in the fitness."""

import dataclasses
import math

import numpy as np
import pytest

from bt_jax.behaviors import Vocabulary
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task

PRICED = load_task("mobile_stack")
PRICED = dataclasses.replace(PRICED, weights=dataclasses.replace(PRICED.weights, travel=7.0))
TREES = [
    parse_tree(text)
    for text in (
        "Sequence(carry(YellowBox, (0, 0, 0.055), KittingBox), carry(GreenBox, (0, 0, 0.1), YellowBox))",
        "Sequence(approach(BlueBox), approach(KittingBox), approach(GreenBox))",
        "Fallback(approach(KittingBox, (0.1, 0, 0.05)), gripper(closed))",
        "gripper(open)",
    )
]


def semantics_of(task):
    return LeafSemantics(task, Vocabulary.of(leaf for tree in TREES for leaf in leaves(tree)))


def test_metres_are_counted_alike_by_table_rollout_and_playback():
    semantics, starts = semantics_of(PRICED), sample_layouts(PRICED, 3, 4)
    trees = encode_all(TREES, semantics.vocabulary, 32)
    found = TableEvaluator(semantics, Kinematic(PRICED), batch=len(TREES))(trees, starts)
    host = RolloutEvaluator(semantics, MujocoPhysics(PRICED), batch=len(TREES))(trees, starts)
    np.testing.assert_allclose(host.travel, found.travel, atol=1e-4)
    settler = Settler(PRICED, Kinematic(PRICED))
    for i, tree in enumerate(TREES):
        for k in range(4):
            played = play(semantics, settler, tree, take(starts, slice(k, k + 1)))
            stops = [played.start.base[0], *(tick.after.base[0] for tick in played.ticks)]
            assert played.travel == pytest.approx(sum(map(math.dist, stops, stops[1:])), abs=1e-4)
            assert found.travel[i, k] == pytest.approx(played.travel, abs=1e-4)
            assert found.values[i, k] == pytest.approx(played.fitness, abs=1e-2)
    assert found.solved[0].all()
    assert not found.travel[3].any()
    free = TableEvaluator(semantics_of(load_task("mobile_stack")), Kinematic(PRICED), batch=len(TREES))(trees, starts)
    np.testing.assert_allclose(found.values, free.values - 7 * found.travel, atol=1e-2)
