import dataclasses
from xml.etree import ElementTree

import pytest
from hypothesis import given

from bt_jax.app.plain_words import Words, differences, differing_settings
from bt_jax.behaviors import EXTENDED, Behavior, ExtendedNode, expand, gene_pool, parse_behavior
from bt_jax.encoding.drawing.svg import node_ids, to_svg
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import Target, load_task, task_names
from tests.helpers.strategies import trees

SVG = "{http://www.w3.org/2000/svg}"
STACK = Words(load_task("stack"))


@pytest.mark.parametrize(
    ("leaf", "words"),
    [
        ("move(YellowBox, (0, 0, 0.055), KittingBox)", "Put YellowBox in the middle of the kit"),
        ("move(YellowBox, (0.133, -0.133, 0.055), KittingBox)", "Put YellowBox in the front right corner of the kit"),
        ("place(BlueBox, (0, 0.133, 0.052), KittingBox)", "Set down BlueBox at the back of the kit"),
        ("at(GreenBox, (0, 0, 0.1), YellowBox)", "Is GreenBox on top of YellowBox?"),
        ("at(GreenBox, (-0.12, 0, 0), YellowBox)", "Is GreenBox left of YellowBox, 20 mm away?"),
        ("at(GreenBox, (0, -0.12, 0), YellowBox)", "Is GreenBox in front of YellowBox, 20 mm away?"),
        ("at(GreenBox, (0.2, 0.3, 0.05), YellowBox)",
         "Is GreenBox 200 mm right of and 300 mm behind YellowBox and 50 mm higher?"),
        ("at(GreenBox, (0.05, 0, 0.1), YellowBox)", "Is GreenBox 50 mm right of YellowBox and 100 mm higher?"),
        ("at(BlueBox, (0.002, 0, 0.206), YellowBox)", "Is BlueBox 106 mm above YellowBox?"),
        ("at(GreenBox, (-0.065, 0, 0.152), KittingBox)", "Is GreenBox 65 mm left of the middle of the kit, 100 mm up?"),
        ("place(BlueBox, (-1, -1, 0.75), base_link)", "Set down BlueBox in the middle of TableLeft"),
        ("place(BlueBox, (0.1, -1, 0.75), base_link)", "Set down BlueBox on TableMiddle, 100 mm right of its middle"),
        ("place(BlueBox, (5, 0, 0.1), base_link)", "Set down BlueBox at x 5000, y 0, z 100 mm from the robot"),
        ("holding(nothing)", "Is the gripper empty?"),
        ("open_gripper", "Open the gripper"),
    ],
)  # fmt: skip
def test_what_people_read(leaf, words):
    assert STACK(parse_behavior(leaf)) == words


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("at(GreenBox, (0, 0, 0.1), YellowBox)", "GreenBox is on top of YellowBox"),
        ("holding(nothing)", "the gripper is empty"),
        ("holding(GreenBox)", "GreenBox is in the gripper"),
        ("gripper(open)", "the gripper is open"),
        ("reachable(GreenBox)", "GreenBox is within reach"),
        ("clear(GreenBox)", "nothing is on GreenBox"),
        ("reached(all_free)", "“all free” was reached before"),
    ],
)
def test_what_holds(condition, words):
    assert STACK.statement(parse_behavior(condition)) == words


def test_right_and_left_are_those_of_a_person_who_faces_the_robot():
    words = Words(load_task("yumi_stack"))  # whose row of tables runs along y, beyond the robot
    assert words(parse_behavior("at(GreenBox, (0, 0.048, 0), BlueBox)")).startswith("Is GreenBox right of BlueBox")
    assert words(parse_behavior("at(GreenBox, (-0.048, 0, 0), BlueBox)")).startswith("Is GreenBox behind BlueBox")


@pytest.mark.parametrize("name", task_names())
def test_all_that_evolution_may_use_reads_differently_and_without_coordinates(name):
    task = load_task(name)
    words = [Words(task)(leaf) for leaf in gene_pool(task).leaves]
    assert len(set(words)) == len(words)
    assert not any("(" in text or " x " in text for text in words)


def test_what_another_task_has_is_told_by_numbers():
    assert STACK(parse_behavior("pick(Cup)")) == "Pick up Cup"
    assert (
        STACK(parse_behavior("at(Cup, (0, 0.01, 0.1), KittingBox)")) == "Is Cup at x 0, y 10, z 100 mm from KittingBox?"
    )
    assert STACK(parse_behavior("move(BlueBox, (0, 0, 0.1), Shelf)")) == "Put BlueBox at x 0, y 0, z 100 mm from Shelf"


@given(trees())
def test_every_node_has_words_and_its_symbol_on_hover(tree):
    root = ElementTree.fromstring(to_svg(tree, words=STACK))
    for i, node in enumerate(prefix(tree)):
        group = next(g for g in root.iter(f"{SVG}g") if g.get("id") == f"node-{i}")
        said = " ".join(text.text for text in group.iter(f"{SVG}text"))
        assert said.removeprefix("→ ").removeprefix("? ") == STACK(node)
        symbol = group.find(f"{SVG}title").text.splitlines()[1]
        assert symbol == (node.kind.name.title() if hasattr(node, "children") else str(node))


@given(trees())
def test_folding_hides_what_is_below_and_says_how_much(tree):
    ids = node_ids(tree)
    assert len(ids) == len(set(ids)) == len(prefix(expand(tree)))
    drawn = _drawn(to_svg(tree, folded=set()))
    assert set(drawn) == set(ids)
    root = _drawn(to_svg(tree, folded={"node-0"}))
    assert set(root) == {"node-0"}
    if len(ids) > 1:
        assert root["node-0"].get("aria-expanded") == "false"
        assert root["node-0"].findall(f"{SVG}text")[-1].text == f"+{len(ids) - 1}"


def test_a_fold_inside_a_gene():
    tree = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), open_gripper)")
    assert "node-1-3" in _drawn(to_svg(tree, folded=set()))
    some = _drawn(to_svg(tree, words=STACK, folded={"node-1-2"}))
    assert [name for name in some if name.startswith("node-1")] == ["node-1", "node-1-1", "node-1-2"]
    assert "foldable" in some["node-1"].get("class")
    assert some["node-1"].get("tabindex") == "0"
    assert 'role="group"' in to_svg(tree, folded=set())
    assert 'role="img"' in to_svg(tree)
    gene = _drawn(to_svg(tree, words=STACK, folded={"node-1"}))
    assert list(gene) == ["node-0", "node-1", "node-2"]
    assert "foldable" not in gene["node-2"].get("class")


@pytest.mark.parametrize("name", EXTENDED)
def test_nodes_of_other_programs_have_words_too(name):
    number = 2 if EXTENDED[name].port else None
    node = ExtendedNode(name, (Behavior("open_gripper"),), number)
    assert " " in STACK(node)
    drawn = _drawn(to_svg(node, words=STACK, folded=set()))
    assert "foldable" in drawn["node-0"].get("class")
    assert name in drawn["node-0"].find(f"{SVG}title").text


def test_numbers_in_words():
    action = (Behavior("open_gripper"),)
    assert STACK(ExtendedNode("Repeat", action, -1)) == "Do this again and again"
    assert STACK(ExtendedNode("RetryUntilSuccessful", action, 3)) == "Try this up to 3 times, until it works"
    assert STACK(ExtendedNode("Timeout", action, 2500)) == "Do this within 2.5 seconds"


def _drawn(svg):
    groups = ElementTree.fromstring(svg).iter(f"{SVG}g")
    return {group.get("id"): group for group in groups if (group.get("id") or "").startswith("node-")}


def test_in_what_two_tasks_differ():
    task = load_task("stack")
    fixed, again = (
        dataclasses.replace(task, layout=dataclasses.replace(task.layout, fixed=(Target("GreenBox", at, "base_link"),)))
        for at in ((0.0, -1.0, 0.75), (0.1, -1.0, 0.75))
    )
    assert differences(fixed, task) == ["boxes start in fixed places"]
    assert differences(task, fixed) == ["boxes start at random"]
    assert differences(fixed, again) == ["boxes start in fixed places, others"]
    priced = dataclasses.replace(task, weights=dataclasses.replace(task.weights, node=99.0), subgoal_reward="seen")
    assert differences(priced, task) == []
    assert differing_settings(priced, task) == ["weights", "rule for subgoals"]
