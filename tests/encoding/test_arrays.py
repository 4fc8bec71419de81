import jax
import numpy as np
import pytest
from hypothesis import given

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, Vocabulary
from bt_jax.encoding.arrays import decode, encode, encode_all, length, violations
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.limits import MAX_NODES
from bt_jax.encoding.walk import leaves, prefix, tidy
from tests.helpers.samples import random_trees
from tests.helpers.strategies import ATOMS, GENES, SUBTASKS, trees

VOCABULARY = Vocabulary.of((*ATOMS, *GENES, *SUBTASKS))
C = Behavior("holding", ("nothing",))
A, B = Behavior("pick", ("YellowBox",)), Behavior("open_gripper")
GENE = GENES[-1]


@given(trees(max_leaves=12))
def test_arrays_hold_the_tree(tree):
    encoded = encode(tree, VOCABULARY, 40)
    nodes = prefix(tree)
    assert encoded.tokens.dtype == np.int16
    assert encoded.sizes.dtype == np.uint8
    assert length(encoded) == len(nodes)
    assert list(encoded.sizes[: len(nodes)]) == [len(prefix(node)) for node in nodes]
    assert not encoded.tokens[len(nodes) :].any()
    assert not encoded.sizes[len(nodes) :].any()
    assert decode(encoded, VOCABULARY) == tree


def test_batches_are_stacked_and_sliced():
    several = random_trees(0, (*ATOMS, *GENES), 50, most_leaves=10)
    batch = encode_all(several, VOCABULARY, 64)
    assert batch.num_nodes == 64
    for i, tree in enumerate(several):
        assert decode(batch[i], VOCABULARY) == tree
    leaves, structure = jax.tree.flatten(batch)
    assert jax.tree.unflatten(structure, leaves).tokens is batch.tokens


def test_the_biggest_tree_fits_and_one_node_more_does_not():
    biggest = Control.sequence(*([A, B] * MAX_NODES)[: MAX_NODES - 1])
    assert decode(encode(biggest, VOCABULARY, MAX_NODES), VOCABULARY) == biggest
    with pytest.raises(UserError, match=f"{MAX_NODES} nodes and {MAX_NODES - 1} fit; raise --max-nodes"):
        encode(biggest, VOCABULARY, MAX_NODES - 1)
    with pytest.raises(UserError, match=f"{MAX_NODES + 1} nodes and 64 fit; give a tree of {MAX_NODES} nodes at most"):
        encode(Control.sequence(*([A, B] * MAX_NODES)[:MAX_NODES]), VOCABULARY, 64)


def test_a_leaf_outside_the_vocabulary_is_named():
    with pytest.raises(UserError, match=r"pick\(YellowBox\)"):
        encode(A, Vocabulary.of(GENES), 8)


@given(trees(max_leaves=12))
def test_the_strategy_breaks_no_rule(tree):
    assert violations(tree) == []


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (C, "single condition"),
        (Control.sequence(A), "has 1 children"),
        (Control.sequence(), "has 0 children"),
        (Control.sequence(A, Control.sequence(C, B)), "under its own kind"),
        (Control.fallback(Control.sequence(C, A), Control.fallback(C, B)), "under its own kind"),
        (Control.sequence(A, A), "is beside an equal one"),
        (Control.sequence(A, C, B), "directly follows"),
        (Control.sequence(C, Control.fallback(A, B), C), "last child"),
    ],
)
def test_each_rule_is_checked(tree, words):
    assert any(words in violation for violation in violations(tree))


def test_genes_under_a_fallback_are_an_option():
    tree = Control.fallback(C, GENE)
    assert violations(tree) == []
    assert len(violations(tree, gene_under_fallback=False)) == 1
    assert violations(Control.sequence(C, GENE), gene_under_fallback=False) == []


def test_kinds_of_tokens_are_ranges():
    kinds = VOCABULARY.kinds
    assert list(kinds[:3]) == [Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK]
    assert (np.diff(kinds) >= 0).all()


def test_nodes_that_arrays_do_not_hold_are_named():
    tree = parse_tree("Sequence(pick(A), Repeat(3, pick(A)), open_gripper)")
    with pytest.raises(UserError, match="arrays hold Sequence, Fallback, retry, timeout and leaves, not Repeat 3"):
        encode(tree, Vocabulary.of(leaves(tree)), 8)
    assert violations(tree) == ["Repeat 3 is none of Sequence, Fallback, retry and timeout"]
    assert violations(tree.children[1]) == violations(tree)


@pytest.mark.parametrize(
    ("text", "broken"),
    [
        ("Sequence(retry(3, pick(A)), timeout(5, retry(2, Fallback(gripper(open), open_gripper))))", []),
        ("Fallback(retry(3, Fallback(gripper(open), open_gripper)), open_gripper)", []),
        ("retry(3, pick(A))", []),
        ("retry(3, timeout(9, Sequence(pick(A), pick(B))))", []),
        ("retry(3, retry(9, Sequence(pick(A), pick(B))))", ["retry 9 is directly under its own kind"]),
        ("Sequence(pick(A), retry(3, gripper(open)))", ["retry 3 decorates the condition gripper(open)"]),
        ("Sequence(pick(A), timeout(3, timeout(2, pick(B))))", ["timeout 2 ticks is directly under its own kind"]),
        ("Sequence(pick(A), retry(3, Sequence(pick(B))))", ["a Sequence has 1 children"]),
        (
            "Sequence(pick(A), retry(3, Inverter(pick(B))))",
            ["Inverter is none of Sequence, Fallback, retry and timeout"],
        ),
    ],
)
def test_rules_of_decorators(text, broken):
    assert violations(parse_tree(text)) == broken


@pytest.mark.parametrize(
    ("text", "tidied"),
    [
        ("Sequence(retry(3, Sequence(pick(A))))", "retry(3, pick(A))"),
        ("Sequence(retry(3, gripper(open)), pick(A))", "Sequence(gripper(open), pick(A))"),
        (
            "Fallback(pick(A), retry(2, retry(3, Fallback(pick(B), pick(C)))))",
            "Fallback(pick(A), retry(3, Fallback(pick(B), pick(C))))",
        ),
    ],
)
def test_tidying_keeps_decorators_that_mean_something(text, tidied):
    assert tidy(parse_tree(text)) == parse_tree(tidied)
