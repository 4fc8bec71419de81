import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, expand
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.formats.text import format_tree, one_line, parse_tree
from bt_jax.encoding.walk import depth, prefix
from tests.helpers.strategies import ATOMS, GENES, trees

EXAMPLE = Control.sequence(
    Behavior("move", ("YellowBox", (0.0, 0.0, 0.055), "KittingBox")),
    Control.fallback(Behavior("gripper", ("open",)), Behavior("open_gripper")),
)


@given(trees())
def test_strategy_makes_valid_trees(tree):
    assert violations(tree) == []


@given(trees())
def test_both_forms_round_trip(tree):
    assert parse_tree(format_tree(tree)) == tree
    assert parse_tree(one_line(tree)) == tree


@given(trees(GENES, max_leaves=2))
def test_both_forms_round_trip_with_genes_expanded(tree):
    assert parse_tree(format_tree(expand(tree))) == expand(tree)
    assert parse_tree(one_line(expand(tree))) == expand(tree)


@given(trees())
def test_lines_are_the_prefix_order(tree):
    lines = format_tree(tree).splitlines()
    nodes = prefix(tree)
    assert len(lines) == len(nodes)
    for line, node in zip(lines, nodes, strict=True):
        assert line.strip() == (str(node) if isinstance(node, Behavior) else node.kind.name.title())
    assert max(len(line) - len(line.lstrip()) for line in lines) == 2 * (depth(tree) - 1)


@given(trees(), st.integers(1, 7), st.integers(0, 5), st.sampled_from(["\n", "\r\n"]))
def test_layout_of_the_text_does_not_matter(tree, step, margin, newline):
    lines = []
    for line in format_tree(tree).splitlines():
        indent = (len(line) - len(line.lstrip())) // 2
        lines += ["", "   # a remark", " " * (margin + step * indent) + line.strip() + "  # here too"]
    assert parse_tree(newline.join(lines)) == tree
    assert parse_tree(one_line(tree).replace("(", " (\n ").replace(",", "\n,\n")) == tree


def test_forms_mix():
    text = "Sequence\n  move(YellowBox, (0, 0, 0.055), KittingBox)\n  Fallback(gripper(open), open_gripper)\n"
    assert parse_tree(text) == EXAMPLE
    assert one_line(EXAMPLE) == (
        "Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), Fallback(gripper(open), open_gripper))"
    )


@given(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3))
def test_positions_keep_every_digit(position):
    leaf = Behavior("at", ("YellowBox", position, "KittingBox"))
    assert parse_tree(one_line(leaf)) == leaf


@given(trees(max_leaves=5), st.data())
def test_a_text_cut_short_is_refused(tree, data):
    text = one_line(tree)
    with pytest.raises(UserError):
        parse_tree(text[: data.draw(st.integers(0, len(text) - 1))])


words = st.sampled_from(
    ["Sequence", "Fallback", "(", ")", ",", "\n", "\n  ", "  ", "0.1", "-1e-3", "#", "\t", "é", "x", *map(str, ATOMS)]
)


@given(st.lists(words, max_size=20).map("".join))
def test_any_text_is_read_or_refused_for_the_user(text):
    try:
        tree = parse_tree(text)
    except UserError:
        return
    assert parse_tree(format_tree(tree)) == tree


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no tree; write"),
        ("\n  # only this\n", "no tree; write"),
        ("Sequence", "line 1, column 1: Sequence has no children; indent some"),
        ("Sequence\n  Fallback\n  open_gripper", "line 2, column 3: Fallback has no children"),
        ("Sequence(Fallback, open_gripper)", "line 1, column 10: Fallback has no children"),
        ("Sequnce(open_gripper)", "line 1, column 1: unknown node 'Sequnce'; did you mean Sequence?"),
        ("jump", "unknown node 'jump'; use one of Sequence, Fallback, Resuming"),
        (
            "Parallel\n  jump(x, (1, 2, 3))\n  Sequence(hop, pick(A))",
            "line 1, column 1: unknown nodes 'Parallel', 'jump' (line 2), 'hop' (line 3); use Sequence, ",
        ),
        ("ReactiveSequence\n  pick(A)", "unknown node 'ReactiveSequence'; use Sequence, which is reactive here"),
        ("Repeat\n  pick(A)", "line 1, column 1: Repeat needs its num_cycles; write it as in Repeat(3, ...)"),
        ("Repeat 0\n  pick(A)", "Repeat: num_cycles cannot be 0; give 1 to 2147483647, or -1 for no limit"),
        ("Timeout(2.5, pick(A))", "line 1, column 9: '2.5' is not a whole number; write one, as in Timeout(5000, ...)"),
        ("Repeat(pick(A), 3)", "Repeat takes one number, before its children; write it there, or delete 3"),
        ("Sequence 3\n  pick(A)", "Sequence takes no number; delete 3"),
        ("Inverter\n  pick(A)\n  pick(B)", "Inverter has 2 children; give it one, for instance a Sequence of several"),
        ("subtask(a, Repeat(3, pick(A)))", "the subtask a holds Repeat 3, which cannot be part of one leaf; write the"),
        (
            "Sequence(\u201cpick\u201d)",
            "unexpected '\u201c' (left double quotation mark); names need no quotation marks",
        ),
        ("pick\uff08A)", "line 1, column 5: unexpected '\uff08' (fullwidth left parenthesis); delete it"),
        ("Sequence\n\topen_gripper", "line 2, column 1: found a tab; use spaces"),
        ("Sequence\n    pick(A)\n  pick(B)", "line 3, column 3: indentation by 2 matches no line above; use 4"),
        ("  Sequence\n    pick(A)\npick(B)", "line 3, column 1: indentation by 0 matches no line above; use 2"),
        ("pick(A)\n  pick(B)", "line 2, column 3: the line above takes no children below it; indent"),
        ("Sequence(pick(A))\n  pick(B)", "line 2, column 3: the line above takes no children below it"),
        ("pick(A)\npick(B)", "line 2, column 1: a second root starts here; put both under"),
        ("pick(A) pick(B)", "line 1, column 9: 'pick' follows a complete node; delete it"),
        ("pick(A))", "line 1, column 8: ')' follows a complete node"),
        ("Sequence(pick(A),\n  pick(B)", "line 1, column 9: this '(' is never closed; add ')'"),
        ("Sequence(pick(A),)", "line 1, column 17: nothing follows this ','"),
        ("Sequence(pick(A) pick(B))", "line 1, column 18: found 'pick' where ',' or ')' should be; add it"),
        ("pick", "line 1, column 1: pick takes (object), found 0 arguments"),
        ("Sequence\n  gripper(ajar)", "line 2, column 3: gripper(ajar) is unknown; write"),
        ("at(A, (0, 0), B)", "line 1, column 7: a position has three numbers, found 2"),
        ("at(A, (0, 0, up), B)", "line 1, column 14: 'up' is not a number"),
        ("at(A, (0, 0, nan), B)", "line 1, column 14: 'nan' is not a number"),
        ("pick(3)", "line 1, column 6: found '3' where a name should be"),
        ("pick[A]", "line 1, column 5: unexpected '['; delete it"),
        ("Sequence(" * 3000, "the tree is nested too deeply; make it flatter"),
        ("\n".join(" " * i + "Sequence" for i in range(3000)), "the tree is nested too deeply"),
        ("Sequence(" * 150 + "pick(A)" + ")" * 150, "make it flatter, of at most 150 levels"),
        ("\n".join([*(" " * i + "Inverter" for i in range(150)), " " * 150 + "pick(A)"]), "nested too deeply; make"),
    ],
)
def test_errors_say_where_why_and_what_to_do(text, message):
    with pytest.raises(UserError) as error:
        parse_tree(text)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "same"),
    [
        ("\ufeffSequence\n\u00a0\u00a0pick(A)", "Sequence(pick(A))"),
        ("at(A, (\u22120.133, \u20130.5, 0), B)", "at(A, (-0.133, -0.5, 0), B)"),
        ("Sequence\r\n  pick(A)\r\n", "Sequence(pick(A))"),
    ],
)
def test_what_editors_make_of_spaces_and_minus_signs_is_read(text, same):
    assert one_line(parse_tree(text)) == same


def test_nodes_that_arrays_do_not_hold_round_trip():
    text = """\
ResumingFallback
  RetryUntilSuccessful -1
    SequenceWithMemory
      Inverter
        pick(A)
      ForceFailure
        open_gripper
  Timeout 5000
    KeepRunningUntilFailure
      ForceSuccess
        ResumingSequence
          pick(B)
  Repeat 2
    subtask(a, Inverter(open_gripper))
"""
    tree = parse_tree(text)
    assert format_tree(tree) == text
    assert parse_tree(one_line(tree)) == tree
    assert "RetryUntilSuccessful(-1, SequenceWithMemory(" in one_line(tree)
    assert parse_tree("Repeat(2, Sequence(pick(A)))") == parse_tree("Repeat 2\n  Sequence\n    pick(A)")


def test_decorators_that_count_ticks_round_trip():
    text = """\
Sequence
  retry 3
    Sequence
      look(A)
      pick(A)
  timeout 5
    Fallback
      is_seen(B)
      look(B)
"""
    tree = parse_tree(text)
    assert format_tree(tree) == text
    assert parse_tree(one_line(tree)) == tree
    assert one_line(tree) == (
        "Sequence(retry(3, Sequence(look(A), pick(A))), timeout(5, Fallback(is_seen(B), look(B))))"
    )
