"""Nodes with memory and decorators: a truth table each, from BehaviorTree.CPP's documentation, and identities.

https://www.behaviortree.dev/docs/nodes-library/DecoratorNode, SequenceNode and FallbackNode. A letter is a status: Success,
Failure, Running; a word is what a leaf returns, or a node, in successive ticks of the tree. A dash: it was not ticked.
"""

import itertools
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind
from bt_jax.behaviors.nodes import Symbol
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from tests.helpers.strategies import trees

LETTERS = {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING}
A, B, C = (Symbol(name, Kind.ACTION) for name in "ABC")


def ticked(tree, words, *, step=1.0):
    """What the root and each leaf return while the leaves return `words`; a leaf that is ticked twice at once returns the
    same twice."""
    memory, count = TreeMemory(), len(next(iter(words.values())))
    root, leaves = "", {leaf: "" for leaf in words}
    for k in range(count):
        asked = {}
        tick = tick_tree(
            tree,
            lambda leaf, _, k=k, asked=asked: asked.setdefault(leaf, LETTERS[words[leaf][k]]),
            memory,
            time=k * step,
        )
        memory, root = tick.memory, root + tick.status.name[0]
        for leaf in leaves:
            leaves[leaf] += asked[leaf].name[0] if leaf in asked else "-"
    return root, leaves


@pytest.mark.parametrize(
    ("name", "number", "child", "root"),
    [
        ("Inverter", None, "SFR", "FSR"),
        ("ForceSuccess", None, "SFR", "SSR"),
        ("ForceFailure", None, "SFR", "FFR"),
        ("KeepRunningUntilFailure", None, "SSRSF", "RRRRF"),
        # The child is ticked up to so many times within one tick, as long as it does not return RUNNING.
        ("RetryUntilSuccessful", 3, "FSR", "FSR"),
        ("RetryUntilSuccessful", 3, "RRS", "RRS"),
        ("RetryUntilSuccessful", 1, "RF", "RF"),
        ("RetryUntilSuccessful", -1, "RFFS", "RRRS"),
        ("Repeat", 3, "SFR", "SFR"),
        ("Repeat", 3, "RRF", "RRF"),
        ("Repeat", 1, "RS", "RS"),
        ("Repeat", -1, "RSSF", "RRRF"),
        # One tick is one second here.
        ("Timeout", 2000, "RRRS", "RRFS"),
        ("Timeout", 2500, "RRRRR", "RRRFR"),
        ("Timeout", 2000, "RSRRR", "RSRRF"),
        ("Timeout", 0, "RRRRR", "RRRRR"),
        ("Timeout", 1, "SF", "SF"),
    ],
)
def test_decorators(name, number, child, root):
    assert ticked(ExtendedNode(name, (A,), number), {A: child})[0] == root


def test_attempts_with_children_that_take_their_time():
    """A child that was running and fails is tried again in the same tick; one that fails at once, too."""
    statuses = iter([LETTERS[letter] for letter in "RFRFRF"])
    tree, memory, roots = ExtendedNode("RetryUntilSuccessful", (A,), 3), TreeMemory(), ""
    for _ in range(4):
        tick = tick_tree(tree, lambda *_: next(statuses), memory)
        memory, roots = tick.memory, roots + tick.status.name[0]
    assert roots == "RRRF"  # attempts: R | F R | F R | F


@pytest.mark.parametrize(
    ("tree", "words", "root", "seen"),
    [
        # With memory of the running child: those before it are not ticked again; it starts over after SUCCESS or FAILURE.
        ("ResumingSequence", {A: "SFFS", B: "RRSS"}, "RRSS", {A: "S--S", B: "RRSS"}),
        ("ResumingSequence", {A: "SSS", B: "RFS"}, "RFS", {A: "S-S", B: "RFS"}),
        ("ResumingFallback", {A: "FSSF", B: "RRFS"}, "RRFS", {A: "F--F", B: "RRFS"}),
        ("ResumingFallback", {A: "FFS", B: "RSF"}, "RSS", {A: "F-S", B: "RS-"}),
        # The memoryless ones, for comparison.
        ("Sequence", {A: "SFSS", B: "RRSS"}, "RFSS", {A: "SFSS", B: "R-SS"}),
        ("Fallback", {A: "FSFF", B: "RRFS"}, "RSFS", {A: "FSFF", B: "R-FS"}),
        # SequenceWithMemory keeps its place after FAILURE, too.
        ("SequenceWithMemory", {A: "SFFS", B: "FRSR"}, "FRSR", {A: "S--S", B: "FRSR"}),
    ],
)
def test_control_nodes_with_and_without_memory(tree, words, root, seen):
    nodes = (A, B)
    built = Control(Kind[tree.upper()], nodes) if tree in ("Sequence", "Fallback") else ExtendedNode(tree, nodes)
    assert ticked(built, words) == (root, seen)


def test_a_node_that_is_interrupted_forgets():
    """Condition A interrupts; afterwards the sequence starts over, and attempts and time are counted from the beginning."""
    guarded = Control.sequence(A, ExtendedNode("ResumingSequence", (B, C)))
    assert ticked(guarded, {A: "SSFS", B: "SSSS", C: "RRRR"})[1] == {A: "SSFS", B: "S--S", C: "RR-R"}
    timed = Control.sequence(A, ExtendedNode("Timeout", (B,), 2000))
    assert ticked(timed, {A: "SFSSS", B: "RRRRR"})[0] == "RFRRF"
    kept = Control.sequence(A, ExtendedNode("SequenceWithMemory", (B, C)))
    assert ticked(kept, {A: "SFS", B: "SSS", C: "RRR"})[1] == {A: "SFS", B: "S--", C: "R-R"}


def test_a_running_sibling_on_the_left_interrupts():
    tree = Control.fallback(A, ExtendedNode("ResumingSequence", (B, C)))
    assert ticked(tree, {A: "FRF", B: "SSS", C: "RRR"})[1] == {A: "FRF", B: "S-S", C: "R-R"}


def test_a_loop_without_end_goes_on_in_the_next_tick():
    """BehaviorTree.CPP would never return from this tick."""
    tree = ExtendedNode("RetryUntilSuccessful", (A,), -1)
    assert ticked(tree, {A: "FFS"})[0] == "RRS"


@given(trees(max_leaves=10), st.data())
def test_identities(tree, data):
    """Inverter twice is nothing, and a memoryless tree does not depend on the tick before it."""
    leaves = dict.fromkeys(node for node in prefix(tree) if isinstance(node, Behavior))
    twice = ExtendedNode("Inverter", (ExtendedNode("Inverter", (tree,)),))
    memory, inverted = TreeMemory(), TreeMemory()
    for _ in range(3):
        table = {leaf: data.draw(st.sampled_from(Status)) for leaf in leaves}
        alone = tick_tree(tree, lambda leaf, _, table=table: table[leaf])
        with_memory = tick_tree(tree, lambda leaf, _, table=table: table[leaf], memory)
        wrapped = tick_tree(twice, lambda leaf, _, table=table: table[leaf], inverted)
        assert alone.statuses == with_memory.statuses == wrapped.statuses[2:]
        assert alone.status == wrapped.status
        memory, inverted = with_memory.memory, wrapped.memory


def test_de_morgan():
    """Sequence(A, B) is Inverter(Fallback(Inverter(A), Inverter(B)))."""
    invert = lambda node: ExtendedNode("Inverter", (node,))  # noqa: E731
    other = invert(Control.fallback(invert(A), invert(B)))
    for a, b in itertools.product("SFR", repeat=2):
        assert ticked(Control.sequence(A, B), {A: a, B: b}) == ticked(other, {A: a, B: b})


def test_at_most_one_leaf_runs():
    """Also in random trees of all nodes: what runs is the last ticked leaf, and the root is RUNNING then."""
    rng = random.Random(0)
    for _ in range(300):
        tree, memory = _random_tree(rng, 5), TreeMemory()
        nodes = prefix(tree)
        for k in range(4):
            tick = tick_tree(tree, lambda *_: rng.choice(list(Status)), memory, time=float(k))
            memory = tick.memory
            running = [
                i for i, status in enumerate(tick.statuses) if status == Status.RUNNING and isinstance(nodes[i], Symbol)
            ]
            assert len(running) <= 1
            assert not running or tick.running == running[0]


def _random_tree(rng, depth):
    if depth == 0 or rng.random() < 0.2:
        return rng.choice((A, B, C))
    name = rng.choice(("Sequence", "Fallback", *CHILDREN))
    below = tuple(_random_tree(rng, depth - 1) for _ in range(CHILDREN.get(name, (3, None))[0]))
    if name in ("Sequence", "Fallback"):
        return Control(Kind[name.upper()], below)
    return ExtendedNode(name, below, CHILDREN[name][1])


CHILDREN = {
    "ResumingSequence": (2, None),
    "ResumingFallback": (2, None),
    "SequenceWithMemory": (2, None),
    "Inverter": (1, None),
    "ForceSuccess": (1, None),
    "ForceFailure": (1, None),
    "RetryUntilSuccessful": (1, 3),
    "Repeat": (1, 2),
    "Timeout": (1, 2000),
    "KeepRunningUntilFailure": (1, None),
}


@pytest.mark.parametrize(
    ("name", "children", "number", "message"),
    [
        ("Inverter", (A, B), None, "Inverter has 2 children; give it one"),
        ("ResumingSequence", (), None, "ResumingSequence has no children"),
        ("Inverter", (A,), 3, "Inverter takes no number; delete 3"),
        ("Timeout", (A,), None, r"Timeout needs its msec; write it as in Timeout\(2500, ...\)"),
        ("Timeout", (A,), -1, "Timeout: msec cannot be -1; give milliseconds"),
        ("Repeat", (A,), 2**31, "Repeat: num_cycles cannot be 2147483648; give 1 to"),
    ],
)
def test_what_does_not_fit_is_refused(name, children, number, message):
    with pytest.raises(UserError, match=message):
        ExtendedNode(name, children, number)
