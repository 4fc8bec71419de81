"""Which trees evolution can start from."""

import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Kind
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.encoding.walk import prefix
from bt_jax.gp.config import GPConfig
from bt_jax.training.baseline import evolvable


def test_a_memoryless_decorator_becomes_one_leaf_with_what_is_below_it():
    inverted = "Inverter(Fallback(gripper(closed), ForceFailure(open_gripper)))"
    tree = evolvable(parse_tree(f"Sequence({inverted}, pick(YellowBox), {inverted})"), GPConfig())
    nodes = prefix(tree)
    assert [getattr(node, "name", "Sequence") for node in nodes] == ["Sequence", "subtask", "pick", "subtask"]
    assert nodes[1] == nodes[3]
    assert nodes[1].kind == Kind.GENE
    assert one_line(nodes[1].body) == inverted
    assert parse_tree(one_line(tree)) == tree
    assert evolvable(tree, GPConfig()) == tree


def test_what_is_memoryless_stays_as_it_is():
    tree = parse_tree("Sequence(Fallback(gripper(open), open_gripper), pick(YellowBox))")
    assert evolvable(tree, GPConfig()) == tree
    assert evolvable(Behavior("open_gripper"), GPConfig()) == Behavior("open_gripper")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "Sequence(open_gripper, RetryUntilSuccessful(3, pick(A)))",
            "cannot be evolved: RetryUntilSuccessful 3 depends on",
        ),
        (
            "Inverter(Timeout(100, pick(A)))",
            "Timeout 100 ms depends on earlier ticks, which evolved trees do not; replace",
        ),
        ("Sequence(pick(A))", "the baseline cannot be evolved: a Sequence has 1 children; fix the tree"),
    ],
)
def test_others_are_refused_by_name(text, message):
    with pytest.raises(UserError, match=message):
        evolvable(parse_tree(text), GPConfig())
