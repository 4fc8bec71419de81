import py_trees
import pytest
from hypothesis import given
from hypothesis import strategies as st
from py_trees.common import Status
from py_trees.composites import Selector, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, expand
from bt_jax.encoding.formats.py_trees import Leaf, to_py_trees
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.status import Status as OurStatus
from bt_jax.encoding.walk import prefix
from tests.helpers.strategies import trees

STATUSES = (Status.SUCCESS, Status.FAILURE, Status.RUNNING)


def evaluate(node, status_of):
    """The definition of memoryless Sequences and Fallbacks, as a recursion."""
    if isinstance(node, Behavior):
        return status_of(node)
    going_on = Status.SUCCESS if node.kind == Kind.SEQUENCE else Status.FAILURE
    for child in node.children:
        status = evaluate(child, status_of)
        if status != going_on:
            return status
    return going_on


@given(trees(max_leaves=20), st.booleans(), st.data())
def test_ticks_as_defined_without_memory(tree, expand_genes, data):
    written = expand(tree) if expand_genes else tree
    leaves = [node for node in prefix(written) if isinstance(node, Behavior)]
    table: dict[Behavior, Status] = {}
    ticked: list[Behavior] = []

    def status_of(behavior):
        ticked.append(behavior)
        return table[behavior]

    root = to_py_trees(tree, status_of, expand_genes=expand_genes)
    for _ in range(3):
        table.update({leaf: data.draw(st.sampled_from(STATUSES)) for leaf in dict.fromkeys(leaves)})
        ticked.clear()
        expected = evaluate(written, status_of)
        expected_leaves = list(ticked)
        ticked.clear()
        root.tick_once()
        assert root.status == expected
        assert ticked == expected_leaves


@given(trees(), st.booleans())
def test_nodes_are_those_of_the_tree(tree, expand_genes):
    root = to_py_trees(tree, lambda _: Status.SUCCESS, expand_genes=expand_genes)
    found = []

    def visit(node):
        found.append(node)
        for child in node.children:
            visit(child)

    visit(root)
    nodes = prefix(expand(tree) if expand_genes else tree)
    assert len(found) == len(nodes)
    for ours, theirs in zip(nodes, found, strict=True):
        if isinstance(ours, Control):
            assert type(theirs) is (Sequence if ours.kind == Kind.SEQUENCE else Selector)
            assert not theirs.memory
        else:
            assert isinstance(theirs, Leaf)
            assert theirs.behavior == ours
            assert theirs.name == ours.label


EXTENDED = """
ResumingFallback
  RetryUntilSuccessful 3
    Inverter
      gripper(open)
  ResumingSequence
    ForceSuccess
      pick(YellowBox)
    ForceFailure
      pick(BlueBox)
  Timeout 60000
    Repeat 2
      KeepRunningUntilFailure
        open_gripper
"""


def test_other_nodes_become_those_of_py_trees_and_are_drawn():
    root = to_py_trees(parse_tree(EXTENDED), lambda _: Status.SUCCESS)
    found = [type(node).__name__ for node in root.iterate() if not isinstance(node, Leaf)]
    inner = [
        "Inverter",
        "Retry",
        "FailureIsSuccess",
        "SuccessIsFailure",
        "Sequence",
        "SuccessIsRunning",
        "Repeat",
        "Timeout",
    ]
    assert found == [*inner, "Selector"]
    assert root.memory
    assert "RetryUntilSuccessful 3" in py_trees.display.unicode_tree(root)
    assert "Timeout 60000 ms" in py_trees.display.dot_tree(root).to_string()


@pytest.mark.parametrize("text", ["SequenceWithMemory(open_gripper)", "RetryUntilSuccessful(-1, open_gripper)"])
def test_what_py_trees_does_not_have_is_named(text):
    with pytest.raises(UserError, match="py_trees has no"):
        to_py_trees(parse_tree(text), lambda _: Status.SUCCESS)


@given(st.lists(st.sampled_from(STATUSES), min_size=8, max_size=8))
def test_memory_and_decorators_tick_as_in_py_trees(words):
    """Where py_trees has a node of the same meaning."""
    text = "ResumingSequence(Inverter(gripper(open)), ForceSuccess(pick(A)), ResumingFallback(open_gripper, close_gripper))"
    tree, table, memory = parse_tree(text), {}, TreeMemory()
    leaves = [node for node in prefix(tree) if isinstance(node, Behavior)]
    theirs = to_py_trees(tree, table.__getitem__)
    for k in range(4):
        table.update(zip(leaves, (words[2 * k :] + words)[: len(leaves)], strict=True))
        ours = tick_tree(tree, lambda leaf, _: OurStatus[table[leaf].name], memory)
        memory = ours.memory
        theirs.tick_once()
        assert theirs.status.name == ours.status.name


@given(st.lists(st.sampled_from(STATUSES), min_size=12, max_size=12))
def test_decorators_that_count_ticks_tick_as_in_py_trees(words):
    tree, table, memory = parse_tree("Fallback(timeout(2, retry(3, pick(A))), retry(2, pick(B)))"), {}, TreeMemory()
    theirs = to_py_trees(tree, table.__getitem__)
    for k in range(6):
        table.update({Behavior("pick", ("A",)): words[2 * k], Behavior("pick", ("B",)): words[2 * k + 1]})
        ours = tick_tree(tree, lambda leaf, _: OurStatus[table[leaf].name], memory)
        memory = ours.memory
        theirs.tick_once()
        assert theirs.status.name == ours.status.name
