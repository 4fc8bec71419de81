import random

import jax
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, expand, gene_pool
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.protocol import Settled
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task
from tests.helpers.samples import followed

STACK3 = """
Sequence
  move(YellowBox, (0, 0, 0.055), KittingBox)
  move(GreenBox, (0, 0, 0.1), YellowBox)
  move(BlueBox, (0, 0, 0.1), GreenBox)
"""


def vocabulary(task):
    pool = gene_pool(task)
    nodes = [node for gene in pool.leaves[-20:] for node in prefix(expand(gene))]
    return pool.extended(node for node in nodes if isinstance(node, Behavior))


def random_tree(rng, leaves, depth=3):
    """Mostly genes under Sequences, so that episodes last."""
    if depth == 0 or rng.random() < 0.3:
        kind = rng.choices((Kind.CONDITION, Kind.ACTION, Kind.GENE), (1, 2, 6))[0]
        return rng.choice([leaf for leaf in leaves if leaf.kind == kind])
    kind = rng.choices((Kind.SEQUENCE, Kind.FALLBACK), (3, 1))[0]
    return Control(kind, tuple(random_tree(rng, leaves, depth - 1) for _ in range(rng.randint(1, 3))))


def assert_same(a, b):
    for ours, theirs in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("level", ["kinematic", "physics"])
@pytest.mark.parametrize("name", ["stack3", "restack"])
def test_equals_the_evaluator(name, level):
    task = load_task(name)
    semantics = LeafSemantics(task, vocabulary(task))
    physics = Kinematic(task) if level == "kinematic" else make_physics(task, "mujoco")
    rng = random.Random(name)
    trees = [random_tree(rng, semantics.vocabulary.leaves) for _ in range(20)]
    layouts = sample_layouts(task, 7, 2)
    evaluator = TableEvaluator(semantics, physics, batch=len(trees))
    expected = evaluator(encode_all(trees, semantics.vocabulary, 64), layouts)
    table, settler = evaluator.table, Settler(task, physics)
    for p, tree in enumerate(trees):
        for k in range(2):
            played = play(semantics, settler, tree, take(layouts, [k]))
            assert played.ending == expected.ending[p, k]
            assert len(played.ticks) == expected.ticks[p, k]
            assert played.fitness == expected.values[p, k]
            assert played.solved == expected.solved[p, k]
            np.testing.assert_array_equal(played.misses.distance, expected.misses.distance[p, k])
            state = table.ids(played.start)
            for tick in played.ticks:
                assert_same(tick.before, table.worlds(state))
                if tick.command is not None:
                    state = followed(table, state, np.array([semantics.commands.index(tick.command)], np.int32))
            assert_same(played.final, table.worlds(state))
    assert len(set(expected.ending.ravel())) == 3


@pytest.mark.parametrize("level", ["kinematic", "physics"])
def test_a_good_tree_solves_its_task(level):
    task, tree = load_task("stack3"), parse_tree(STACK3)
    semantics = LeafSemantics(task, gene_pool(task).extended(prefix(tree)[1:]))
    physics = Kinematic(task) if level == "kinematic" else make_physics(task, "mujoco")
    played = play(semantics, Settler(task, physics), tree, sample_layouts(task, 0, 1))
    assert played.solved
    commands = [str(tick.command).split(",")[0] for tick in played.ticks]
    assert commands == [
        "pick(YellowBox)",
        "place(YellowBox",
        "pick(GreenBox)",
        "place(GreenBox",
        "pick(BlueBox)",
        "place(BlueBox",
        "None",
        "None",
    ]
    assert played.ticks[2].statuses == (Status.RUNNING, Status.SUCCESS, Status.RUNNING, None)
    for tick in played.ticks[1:]:
        assert (tick.command is None) == (tick.status == Status.SUCCESS)


def test_genes_written_out_do_the_same():
    task = load_task("stack3")
    semantics = LeafSemantics(task, vocabulary(task))
    settler = Settler(task, Kinematic(task))
    rng = random.Random(1)
    genes = [leaf for leaf in semantics.vocabulary.leaves[-20:] if leaf.kind == Kind.GENE]
    layout = sample_layouts(task, 3, 1)
    for _ in range(10):
        tree = random_tree(rng, (*semantics.vocabulary.leaves[:4], Behavior("open_gripper"), *genes))
        folded, written = (play(semantics, settler, t, layout) for t in (tree, expand(tree)))
        assert [tick.command for tick in folded.ticks] == [tick.command for tick in written.ticks]
        assert [tick.status for tick in folded.ticks] == [tick.status for tick in written.ticks]
        assert folded.ending == written.ending


class _Broken:
    """Physics that diverges."""

    name, description = "broken", ""

    def settle(self, kit, poses, present):
        return Settled(poses, np.zeros(len(poses), bool), np.zeros(len(poses), np.int32), poses[..., 0])


def test_broken_physics_ends_the_episode():
    task, tree = load_task("stack3"), parse_tree(STACK3)
    semantics = LeafSemantics(task, gene_pool(task).extended(prefix(tree)[1:]))
    played = play(semantics, Settler(task, _Broken()), tree, sample_layouts(task, 0, 1))
    assert played.ending == Ending.BROKEN
    assert played.fitness == np.float32(WORST_FITNESS)
    assert played.ticks[-1].command.name == "place"


def test_an_unknown_leaf_is_reported():
    task = load_task("stack3")
    semantics = LeafSemantics(task, gene_pool(task))
    with pytest.raises(UserError, match="reachable"):
        play(semantics, Settler(task, Kinematic(task)), parse_tree("reachable(BlueBox)"), sample_layouts(task, 0, 1))
