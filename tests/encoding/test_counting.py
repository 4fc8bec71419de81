"""Decorators that count over ticks: what each means, and the compiled walk against plain Python and py_trees."""

import functools

import jax
import numpy as np
import pytest

from benchmarks.decorators import compare, random_tree
from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, ExtendedNode, Kind, Vocabulary
from bt_jax.behaviors.nodes import Decorator, Symbol
from bt_jax.encoding import decode, encode, encode_all
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.tick import counters, jump_table, tick_trees
from bt_jax.encoding.walk import decorators, extended_nodes, leaves, prefix

A, B, C = (Symbol(name, Kind.ACTION) for name in "ABC")
VOCABULARY = Vocabulary.of(
    (A, B, C),
    [*(Decorator(Kind.RETRY, number) for number in (1, 2, 3, 9)), *(Decorator(Kind.TIMEOUT, n) for n in (1, 2, 3))],
)
LETTERS = {"S": Status.SUCCESS, "F": Status.FAILURE, "R": Status.RUNNING}


def retry(number, child):
    return ExtendedNode("retry", (child,), number)


def timeout(number, child):
    return ExtendedNode("timeout", (child,), number)


@functools.partial(jax.jit, static_argnames="halted")
def walk(trees, row, counts, halted=0):
    table = jump_table(trees, counters(VOCABULARY))
    return tick_trees(table, lambda token: row[token], counts=counts, halted=halted)


def ticked(tree, words):
    """What the root returns, and which leaves are RUNNING and not halted, while the leaves return `words`, letter by
    letter; the compiled walk does the same."""
    trees, nodes = encode_all([tree], VOCABULARY, 16), prefix(tree)
    memory, counts, root, acts = TreeMemory(), np.zeros((1, 16), np.uint8), "", ""
    for k in range(len(next(iter(words.values())))):
        row = np.zeros(len(VOCABULARY), np.int32)
        for leaf, word in words.items():
            row[VOCABULARY.token(leaf)] = LETTERS[word[k]]
        tick = tick_tree(tree, lambda leaf, _, row=row: Status(row[VOCABULARY.token(leaf)]), memory)
        walked = walk(trees, row, counts)
        assert walked.status[0] == tick.status
        assert tick.running == (int(walked.leaf[0]) if tick.status == Status.RUNNING else None)
        memory, counts = tick.memory, walked.counts
        root += tick.status.name[0]
        running = None if tick.running is None else nodes[tick.running]
        acts += str(running) if isinstance(running, Symbol) else "-"
        assert bool(walked.acts[0]) == isinstance(running, Symbol)
    return root, acts


@pytest.mark.parametrize(
    ("tree", "words", "root", "acts"),
    [
        # A failure is RUNNING until the third, and then the count begins again.
        (retry(3, A), {A: "FFFFS"}, "RRFRS", "-----"),
        (retry(1, A), {A: "FRS"}, "FRS", "-A-"),
        # Running does not count, and does not forget; success forgets.
        (retry(3, A), {A: "FRFRF"}, "RRRRF", "-A-A-"),
        (retry(2, A), {A: "FSFF"}, "RSRF", "----"),
        # The third tick in a row in which the child runs is a failure, and what ran is not carried out.
        (timeout(3, A), {A: "RRRRRRS"}, "RRFRRFS", "AA-AA--"),
        (timeout(2, A), {A: "RSRF"}, "RSRF", "A-A-"),
        (timeout(1, A), {A: "RSF"}, "FSF", "---"),
        # After a timeout another action may run in the same tick.
        (Control.fallback(timeout(2, A), B), {A: "RRRR", B: "RRRR"}, "RRRR", "ABAB"),
        # What is not ticked, or does not return RUNNING, forgets.
        (Control.sequence(A, retry(2, B)), {A: "SFSS", B: "FFFF"}, "RFRF", "----"),
        (Control.fallback(A, timeout(2, B)), {A: "FRFF", B: "RRRR"}, "RRRF", "BAB-"),
        # Both around each other: each attempt has its own time, or all have one.
        (retry(2, timeout(2, A)), {A: "RRRR"}, "RRRF", "A-A-"),
        (timeout(3, retry(9, A)), {A: "FFFF"}, "RRFR", "----"),
        # What a timeout has halted forgets.
        (Control.fallback(timeout(2, retry(3, A)), B), {A: "FFFF", B: "FSFS"}, "RSRS", "----"),
    ],
)
def test_what_decorators_mean(tree, words, root, acts):
    assert ticked(tree, words) == (root, acts)


def test_the_status_of_what_a_timeout_has_halted_is_not_shown():
    tick = tick_tree(Control.fallback(timeout(1, A), B), lambda *_: Status.RUNNING)
    assert tick.statuses == (Status.RUNNING, Status.FAILURE, None, Status.RUNNING)
    assert tick.running == 3


def test_ticks_may_count_in_part():
    """A robot ticks more often than the simulation: three ticks of the simulation are six halves."""
    memory, roots = TreeMemory(), ""
    for _ in range(6):
        tick = tick_tree(timeout(3, A), lambda *_: Status.RUNNING, memory, ticks=0.5)
        memory, roots = tick.memory, roots + tick.status.name[0]
    assert roots == "RRRRRF"


def test_what_is_noted_of_an_action_counts_unless_it_is_halted():
    trees = encode_all([Control.fallback(timeout(1, A), B)], VOCABULARY, 16)
    outcomes = np.zeros(len(VOCABULARY), np.int32)
    outcomes[VOCABULARY.token(A)] = 0b11_0100 | Status.RUNNING
    outcomes[VOCABULARY.token(B)] = 0b10_1000 | Status.RUNNING
    walked = walk(trees, outcomes, np.zeros((1, 16), np.uint8), halted=0b1111)
    assert int(walked.noted[0]) == 0b11_1000


def test_the_compiled_walk_and_plain_python_tick_as_py_trees_does():
    assert compare(50, ticks=5, seed=3) == {"trees": 50, "ticks": 250, "differences": 0}


def test_arrays_hold_them():
    rng = np.random.default_rng(5)
    forest = [random_tree(rng, 12) for _ in range(50)]
    vocabulary = Vocabulary.of(
        (leaf for tree in forest for leaf in leaves(tree)), (one for tree in forest for one in decorators(tree))
    )
    for tree in forest:
        assert decode(encode(tree, vocabulary, 250), vocabulary) == tree
        assert extended_nodes(tree) == []
    kinds = vocabulary.kinds.tolist()
    assert kinds == sorted(kinds)
    assert vocabulary.limits[vocabulary.token(Decorator(Kind.RETRY, 2))] == 2
    assert Vocabulary.of(vocabulary.leaves).kinds.tolist() == kinds[: 3 + len(vocabulary.leaves)]


@pytest.mark.parametrize(
    ("name", "number", "message"),
    [
        ("retry", None, r"retry needs its num_attempts; write it as in retry\(3, ...\)"),
        ("retry", 0, "retry: num_attempts cannot be 0; give 1 to 255"),
        ("timeout", 256, "timeout: num_ticks cannot be 256; give 1 to 255"),
        ("timeout", -1, "timeout: num_ticks cannot be -1; give 1 to 255"),
    ],
)
def test_numbers_out_of_range_are_refused(name, number, message):
    with pytest.raises(UserError, match=message):
        ExtendedNode(name, (A,), number)


def test_a_decorator_that_the_vocabulary_lacks_is_named():
    with pytest.raises(UserError, match=r"the decorator retry\(3\) is not in the vocabulary"):
        encode(retry(3, Behavior("open_gripper")), Vocabulary.of([Behavior("open_gripper")]), 8)
