"""Nodes that do nothing go, and nothing else."""

import pytest
from hypothesis import given, settings

from bt_jax.behaviors import Behavior, Vocabulary
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import load_task
from bt_jax.training.simplify import simplify, smaller_trees
from tests.helpers.strategies import GENES, trees

TASK = load_task("stack")
PHYSICS = Kinematic(TASK)
LAYOUTS = sample_layouts(TASK, 0, 8)
SOLUTION = "Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))"


@given(trees(max_leaves=10))
def test_every_smaller_tree_is_valid_and_smaller(tree):
    candidates = smaller_trees(tree)
    sizes = [len(prefix(other)) for other in candidates]
    assert sizes == sorted(sizes)
    assert len(set(candidates)) == len(candidates)
    for other in candidates:
        assert len(prefix(other)) < len(prefix(tree))
        assert not violations(other)


def test_decorators_are_removed_too():
    text = "Sequence(retry(3, Sequence(pick(A), pick(B))), open_gripper)"
    assert {str(tree) for tree in smaller_trees(parse_tree(text))} == {
        "open_gripper",
        "Sequence(retry(3, pick(A)), open_gripper)",
        "Sequence(retry(3, pick(B)), open_gripper)",
        "Sequence(pick(A), pick(B), open_gripper)",
        "retry(3, Sequence(pick(A), pick(B)))",
    }


@pytest.mark.parametrize(
    "text",
    [
        SOLUTION,
        SOLUTION.replace("Sequence(", "Sequence(timeout(9, retry(3, ").replace("KittingBox)", "KittingBox)))"),
        "Sequence(Fallback(gripper(closed), open_gripper), move(BlueBox, (0, 0, 0.1), GreenBox))",
        f"Sequence(Fallback(gripper(closed), open_gripper), {SOLUTION[9:]}",
        f"Fallback({SOLUTION}, Sequence(close_gripper, open_gripper))",
        f"Sequence(Fallback({SOLUTION}, close_gripper), Fallback(gripper(open), Sequence(open_gripper, close_gripper)))",
    ],
)
def test_what_does_nothing_goes(text):
    tree = parse_tree(text)
    found = simplify(TASK, PHYSICS, tree, LAYOUTS)
    assert found.removed == len(prefix(tree)) - len(prefix(found.tree))
    if "YellowBox, (0" in text:
        assert found.tree == parse_tree(SOLUTION)
    else:
        assert str(found.tree) == "move(BlueBox, (0, 0, 0.1), GreenBox)"


@settings(max_examples=8)
@given(trees((*GENES[:20], Behavior("open_gripper"), Behavior("gripper", ("open",))), max_leaves=5))
def test_the_simplified_tree_ends_as_the_tree_does(tree):
    found = simplify(TASK, PHYSICS, tree, LAYOUTS).tree

    def ends(one):
        semantics = LeafSemantics(TASK, Vocabulary.of(node for node in prefix(one) if isinstance(node, Behavior)))
        settler = Settler(TASK, PHYSICS)
        return [play(semantics, settler, one, take(LAYOUTS, slice(k, k + 1))) for k in range(8)]

    for ours, theirs in zip(ends(found), ends(tree), strict=True):
        assert ours.solved >= theirs.solved
        nodes = 10.0 * (len(prefix(tree)) - len(prefix(found)))
        assert ours.fitness >= theirs.fitness + nodes - 0.1


def test_a_tree_of_one_leaf_stays():
    assert smaller_trees(GENES[0]) == []
