"""A tree as a list: the same nodes as in the drawing, with what they returned."""

import re

from bt_jax.app.plain_words import Words
from bt_jax.app.widgets.tree_text import tree_list
from bt_jax.behaviors import expand
from bt_jax.encoding.drawing.svg import node_ids
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import load_task

TASK = load_task("stack")
TREE = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), move(GreenBox, (0, 0, 0.1), YellowBox))")
WORDS = Words(TASK)


def items(html):
    return re.findall(r"<li>([^<]*)", html)


def test_every_node_is_an_item_in_prefix_order():
    assert items(tree_list(TREE, WORDS, {}, ())) == [
        said for i, node in enumerate(prefix(TREE)) for said in [WORDS(node), *inside(node)]
    ]


def inside(node):
    """The nodes below the root of a gene's subtree; the gene stands for that root."""
    return [] if getattr(node, "subtree", None) is None else list(map(WORDS, prefix(expand(node))[1:]))


def test_what_is_folded_is_not_listed():
    assert items(tree_list(TREE, WORDS, {}, {"node-1", "node-2"})) == list(map(WORDS, prefix(TREE)))
    assert items(tree_list(TREE, WORDS, {}, {"node-0"})) == [WORDS(TREE)]


def test_the_statuses_are_those_of_the_drawing():
    ids = node_ids(TREE)
    html = tree_list(TREE, WORDS, {name: "running" if name.endswith("-2") else "idle" for name in ids}, ())
    assert [item.endswith(": at work") for item in items(html)] == [name.endswith("-2") for name in ids]
    assert all(item.endswith((": at work", ": not asked")) for item in items(html))


def test_names_are_escaped():
    assert "<b>" not in tree_list(TREE, lambda node: "<b>&", {}, ())
