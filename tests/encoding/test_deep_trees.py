"""Trees as deep as they may be: everything that visits a tree calls itself at every level, and Python allows 1,000 calls."""

import sys

import pytest

from bt_jax.behaviors import check_names, expand
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text, to_dot
from bt_jax.encoding.formats.depth import MAX_DEPTH
from bt_jax.encoding.formats.text import format_tree, one_line, parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task


@pytest.fixture(autouse=True)
def twice_the_calls():
    """In tests, types are checked at each call, by another one."""
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(2 * limit)
    yield
    sys.setrecursionlimit(limit)


@pytest.mark.parametrize("name", ["Sequence", "Inverter"])
def test_nothing_is_too_deep(name):
    levels = MAX_DEPTH - 1
    text = "".join(f"{' ' * i}{name}\n" for i in range(levels)) + f"{' ' * levels}open_gripper\n"
    tree = parse_tree(text)
    assert from_xml(to_xml(tree)) == parse_tree(one_line(tree)) == parse_tree(format_tree(tree)) == expand(tree) == tree
    assert len(draw_text(tree).splitlines()) == MAX_DEPTH
    assert "open_gripper" in to_svg(tree)
    assert "open_gripper" in to_dot(tree)
    assert tick_tree(tree, lambda *_: Status.RUNNING).running == levels
    check_names(parse_tree(f"subtask(deep, {name}({name}(open_gripper)))"), load_task("stack"))
