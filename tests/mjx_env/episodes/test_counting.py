"""Episodes of trees with retry and timeout: the table, the rollout and plain Python are the same."""

import random

import numpy as np
import pytest

from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind, Vocabulary, gene_pool
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import decorators, leaves
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task

TASK = load_task("stack")
PHYSICS = Kinematic(TASK)
LAYOUTS = sample_layouts(TASK, 0, 2)
BOXES = ("YellowBox", "GreenBox", "BlueBox")
ATOMS = (
    *(Behavior("pick", (box,)) for box in BOXES),
    *(Behavior("holding", (box,)) for box in BOXES),
    *(Behavior(kind, ("YellowBox",)) for kind in ("look", "is_seen")),
)
LEAVES = (*gene_pool(TASK).leaves, *ATOMS)


def random_tree(rng, depth=4):
    if depth == 0 or rng.random() < 0.2:
        kind = rng.choices((Kind.CONDITION, Kind.ACTION, Kind.GENE), (1, 3, 4))[0]
        return rng.choice([leaf for leaf in LEAVES if leaf.kind == kind])
    if rng.random() < 0.4:
        return ExtendedNode(rng.choice(("retry", "timeout")), (random_tree(rng, depth - 1),), rng.randint(1, 3))
    kind = rng.choices((Kind.SEQUENCE, Kind.FALLBACK), (3, 2))[0]
    return Control(kind, tuple(random_tree(rng, depth - 1) for _ in range(rng.randint(1, 3))))


def assert_the_same(evaluator, trees, semantics, physics=PHYSICS):
    found = evaluator(encode_all(trees, semantics.vocabulary, 128), LAYOUTS)
    settler = Settler(TASK, physics)
    for i, tree in enumerate(trees):
        for k in range(len(LAYOUTS.held)):
            played = play(semantics, settler, tree, take(LAYOUTS, slice(k, k + 1)))
            assert played.ending == found.ending[i, k], tree
            assert len(played.ticks) == found.ticks[i, k], tree
            assert played.fitness == pytest.approx(found.values[i, k]), tree
    return found


def forest(seed, count):
    rng = random.Random(seed)
    trees = [random_tree(rng) for _ in range(count)]
    used = [decorator for tree in trees for decorator in decorators(tree)]
    return trees, LeafSemantics(TASK, Vocabulary.of(LEAVES, used))


def test_the_table_runs_them_as_plain_python_does():
    trees, semantics = forest(1, 60)
    found = assert_the_same(TableEvaluator(semantics, PHYSICS, batch=60), trees, semantics)
    assert {Ending.SUCCESS, Ending.FAILURE, Ending.TIMEOUT} <= set(found.ending.ravel())


@pytest.mark.slow
@pytest.mark.parametrize("physics", [PHYSICS, make_physics(TASK, "mujoco")], ids=["compiled", "on the host"])
def test_rollouts_run_them_as_plain_python_does(physics):
    trees, semantics = forest(2, 20)
    assert_the_same(RolloutEvaluator(semantics, physics, batch=20), trees, semantics, physics)


@pytest.mark.parametrize(
    ("text", "commands"),
    [
        # Picking fails while the gripper holds something else; each retry costs a tick in which nothing acts.
        (
            "Sequence(Fallback(holding(YellowBox), pick(YellowBox)), retry(3, pick(GreenBox)))",
            ["pick(YellowBox)", None, None, None],
        ),
        # A timeout hands over before its action is carried out.
        (
            "Sequence(Fallback(timeout(1, pick(YellowBox)), pick(GreenBox)), close_gripper)",
            ["pick(GreenBox)", None, None],
        ),
    ],
)
def test_what_acts_in_each_tick(text, commands):
    tree = parse_tree(text)
    semantics = LeafSemantics(TASK, Vocabulary.of(leaves(tree)))
    playback = play(semantics, Settler(TASK, PHYSICS), tree, take(LAYOUTS, slice(0, 1)))
    assert [None if tick.command is None else str(tick.command) for tick in playback.ticks] == commands


def test_looking_takes_no_time_where_everything_is_seen():
    tree = parse_tree("Sequence(look(YellowBox), is_seen(GreenBox), pick(YellowBox))")
    semantics = LeafSemantics(TASK, Vocabulary.of(leaves(tree)))
    playback = play(semantics, Settler(TASK, PHYSICS), tree, take(LAYOUTS, slice(0, 1)))
    assert [str(tick.command) for tick in playback.ticks][:1] == ["pick(YellowBox)"]
    assert np.isfinite(playback.fitness)
