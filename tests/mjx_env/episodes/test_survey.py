"""Trees that arrays cannot hold, in the simulation: the same numbers where both ways can be taken, and what loops do."""

import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Behavior, Control, ExtendedNode, Vocabulary
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.interpret import TreeMemory
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import leaves, prefix
from bt_jax.mjx_env.episodes.playback import EpisodeState, play
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import load_task

TASK = load_task("stack")
PHYSICS = Kinematic(TASK)
LAYOUTS = sample_layouts(TASK, 0, 3)
PLACES = {"YellowBox": "(0, 0, 0.055), KittingBox", "GreenBox": "(0, 0, 0.1), YellowBox"}
MOVES = ", ".join(f"move({box}, {where})" for box, where in PLACES.items())
STEPS = ", ".join(f"pick({box}), place({box}, {where})" for box, where in PLACES.items())


def twice_inverted(tree):
    return ExtendedNode("Inverter", (ExtendedNode("Inverter", (tree,)),))


def surveyed(tree):
    return survey(LeafSemantics(TASK, Vocabulary.of(leaves(tree))), PHYSICS, tree, LAYOUTS)


def played(text):
    tree = parse_tree(text)
    playback = play(
        LeafSemantics(TASK, Vocabulary.of(leaves(tree))), Settler(TASK, PHYSICS), tree, sample_layouts(TASK, 0, 1)
    )
    return (
        playback,
        "".join(tick.status.name[0] for tick in playback.ticks),
        [str(tick.command) for tick in playback.ticks],
    )


@pytest.mark.parametrize(
    "text", [f"Sequence({MOVES})", "Sequence(pick(YellowBox), open_gripper)", "Fallback(pick(YellowBox))"]
)
def test_both_ways_give_the_same_numbers(text):
    tree = parse_tree(text)
    compiled, plain = surveyed(tree), surveyed(twice_inverted(tree))
    assert compiled.values == pytest.approx(plain.values + 2 * TASK.weights.node)
    assert np.array_equal(compiled.misses.distance, plain.misses.distance)
    for name in ("ending", "ticks", "subgoals_missed", "solved"):
        assert np.array_equal(getattr(compiled, name), getattr(plain, name)), name


def test_a_tree_with_more_nodes_than_arrays_hold_runs():
    large = Control.sequence(parse_tree(f"Sequence({MOVES})"), *[Behavior("reachable", ("YellowBox",))] * MAX_NODES)
    assert len(prefix(large)) > MAX_NODES
    assert surveyed(large).solved.all()


def test_steps_with_memory_are_done_once_and_end_the_episode():
    """Without memory, `pick` would pick the box up again once it has been placed."""
    playback, statuses, commands = played(f"ResumingSequence({STEPS})")
    assert (playback.ending, statuses) == (Ending.SUCCESS, "RRRRS")
    assert commands == [*map(str, prefix(parse_tree(f"Sequence({STEPS})"))[1:]), "None"]
    assert playback.solved
    assert played(f"Sequence({STEPS})")[0].ending == Ending.TIMEOUT


def test_the_clock_of_a_timeout_counts_ticks_of_2500_ms():
    assert played(f"Timeout(10000, ResumingSequence({STEPS}))")[1] == "RRRRF"
    assert played(f"Timeout(10001, ResumingSequence({STEPS}))")[1] == "RRRRS"
    late = f"ResumingFallback(Timeout(5000, ResumingSequence({STEPS})), ForceSuccess(close_gripper))"
    assert played(late)[2] == [*played(f"ResumingSequence({STEPS})")[2][:2], "close_gripper", "None"]


def test_attempts_follow_each_other():
    """The box falls, since nothing is under the place."""
    never = "ResumingSequence(pick(YellowBox), place(YellowBox, (0, 0, 0.5), KittingBox))"
    assert played(never)[1] == "RRF"
    _, statuses, commands = played(f"RetryUntilSuccessful(3, {never})")
    assert statuses == "RRRRRRF"
    assert commands[:2] * 3 == commands[:6]


@pytest.mark.parametrize(
    ("text", "status"), [("pick(YellowBox)", "F"), ("RetryUntilSuccessful(2, pick(YellowBox))", "R")]
)
def test_another_attempt_has_all_ticks_of_an_action_again(text, status):
    tree = parse_tree(text)
    semantics = LeafSemantics(TASK, Vocabulary.of(leaves(tree)))
    start = EpisodeState(semantics, Settler(TASK, PHYSICS), tree, sample_layouts(TASK, 0, 1))
    command = semantics.commands.index(Behavior("pick", ("YellowBox",)))
    runs = np.array([TASK.episode.action_ticks], np.int32)
    spent = dataclasses.replace(start.tally, command=np.array([command], np.int32), runs=runs)
    memory = TreeMemory(frozenset(range(len(prefix(tree)))))
    tick, after = dataclasses.replace(start, tally=spent, memory=memory).tick()
    assert tick.status.name[0] == status
    assert after.tally.runs[0] == (status == "R")


def test_repeat_keep_running_and_inverted_conditions():
    assert played(f"Repeat(2, Sequence({MOVES}))")[1] == "RRRRS"
    assert played("KeepRunningUntilFailure(gripper(open))")[0].ending == Ending.TIMEOUT
    assert played("Sequence(Inverter(gripper(closed)), ForceSuccess(pick(BlueBox)))")[1].startswith("R")


@pytest.mark.parametrize(
    "text",
    [
        "Inverter(Sequence(gripper(open), pick(YellowBox)))",
        "ForceFailure(pick(YellowBox))",
        f"ForceSuccess(Sequence({MOVES}))",
    ],
)
def test_a_memoryless_decorator_is_one_leaf_of_evolution(text):
    """In the table of outcomes it does what the node does."""
    node, action = parse_tree(text), Behavior("open_gripper")
    gene = Behavior("subtask", ("one", node))
    frozen, whole = surveyed(Control.fallback(gene, action)), surveyed(Control.fallback(node, action))
    assert np.array_equal(frozen.ending, whole.ending)
    assert np.array_equal(frozen.misses.distance, whole.misses.distance)


def test_both_ways_count_the_metres_of_a_base():
    task = load_task("mobile_stack")
    tree = parse_tree("carry(YellowBox, (0, 0, 0.055), KittingBox)")
    semantics, layouts = LeafSemantics(task, Vocabulary.of(leaves(tree))), sample_layouts(task, 0, 2)
    compiled, plain = (
        survey(semantics, Kinematic(task), form, layouts).travel for form in (tree, twice_inverted(tree))
    )
    assert compiled.min() > 0
    assert plain == pytest.approx(compiled, abs=1e-4)
