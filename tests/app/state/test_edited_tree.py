"""Whatever a person does with a tree, it stays one that runs; and what they undo is as it was."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.edited_tree import Edited, Part, at, delete, insert, lock, move, nudge, paths, switch, wrap
from bt_jax.app.state.history import History
from bt_jax.behaviors import Behavior, Kind, expand
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.encoding.walk import leaves, prefix

TREE = parse_tree("Sequence(pick(A), Fallback(holding(A), retry(3, open_gripper)), close_gripper)")
LEAVES = [Behavior("open_gripper"), Behavior("pick", ("B",)), Behavior("holding", ("A",))]
HEADS = [Kind.SEQUENCE, Kind.FALLBACK, ("retry", 3), ("timeout", 5)]
WHERE = st.sampled_from(["before", "after", "inside"])


@st.composite
def changes(draw):
    """One thing that a person may do with any node of any tree."""
    number, other, where = draw(st.integers(0, 999)), draw(st.integers(0, 999)), draw(WHERE)
    leaf, head = draw(st.sampled_from(LEAVES)), draw(st.sampled_from(HEADS))
    direction = draw(st.sampled_from(["earlier", "later", "out", "in"]))
    what = draw(st.sampled_from(["insert", "delete", "wrap", "move", "nudge", "switch", "lock"]))

    def change(part):
        places = paths(part)
        path, to = places[number % len(places)], places[other % len(places)]
        return {
            "insert": lambda: insert(part, path, Part(leaf), where),
            "delete": lambda: delete(part, path),
            "wrap": lambda: wrap(part, path, head),
            "move": lambda: move(part, path, to, where),
            "nudge": lambda: nudge(part, path, direction),
            "switch": lambda: switch(part, path),
            "lock": lambda: lock(part, path),
        }[what]()

    return change


@settings(deadline=None)
@given(st.lists(changes(), max_size=12))
def test_every_change_keeps_a_tree_that_runs_and_can_be_undone(steps):
    history = History(Edited(Part.of(TREE), ()))
    versions = [history.present]
    for step in steps:
        try:
            history = history.changed(step(history.present.part))
        except UserError:
            assert history.present is versions[-1]  # what is refused changes nothing
            continue
        versions.append(history.present)
        part, path = history.present.part, history.present.path
        at(part, path)  # what was changed can be selected
        for tree in (part.tree, part.working.tree):
            assert parse_tree(one_line(tree)) == tree
            assert all(node.kind != Kind.PAD for node in prefix(tree) if hasattr(node, "kind"))
            expand(tree)
        assert len(part.works_at) == len(prefix(part.working.tree))
        everything = prefix(part.tree)
        for number, node in zip(part.works_at, prefix(part.working.tree), strict=True):
            assert type(everything[number]) is type(node)
    for version in reversed(versions[:-1]):
        history = history.undone()
        assert history.present == version
    for version in versions[1:]:
        history = history.redone()
        assert history.present == version


@given(changes(), changes())
def test_switching_and_locking_twice_changes_nothing(first, second):
    part = Part.of(TREE)
    for path in paths(part):
        for twice in (switch, lock):
            try:
                once = twice(part, path).part
            except UserError:
                continue
            assert twice(once, path).part == part


def edited(change, *args):
    return one_line(change(Part.of(TREE), *args).part.tree)


def test_what_is_inserted_stands_where_it_was_put():
    look = Part(Behavior("look", ("A",)))
    assert edited(insert, (0,), look, "before").startswith("Sequence(look(A), pick(A), Fallback")
    assert edited(insert, (0,), look, "inside").startswith("Sequence(pick(A), look(A), Fallback")
    assert "retry(3, open_gripper), look(A))" in edited(insert, (1,), look, "inside")
    assert "retry(3, Sequence(open_gripper, look(A)))" in edited(insert, (1, 1), look, "inside")
    assert edited(insert, (), look, "before").startswith("Sequence(look(A), Sequence(pick(A)")
    assert "retry(3, Sequence(look(A), open_gripper))" in edited(insert, (1, 1, 0), look, "before")


def test_what_is_moved_leaves_nothing_empty_behind():
    assert edited(move, (1, 1, 0), (0,), "before") == (
        "Sequence(open_gripper, pick(A), Fallback(holding(A)), close_gripper)"
    )
    assert edited(nudge, (2,), "in").endswith("Fallback(holding(A), retry(3, open_gripper), close_gripper))")
    assert edited(nudge, (1, 0), "out").endswith("Fallback(retry(3, open_gripper)), holding(A), close_gripper)")
    others_off = switch(switch(Part.of(TREE), (1,)).part, (2,)).part
    assert one_line(move(others_off, (0,), (2,), "after").part.working.tree) == "Sequence(pick(A))"
    with pytest.raises(UserError, match="into itself"):
        move(Part.of(TREE), (1,), (1, 1), "inside")
    with pytest.raises(UserError, match="any further"):
        nudge(Part.of(TREE), (0,), "earlier")


def test_what_is_switched_off_does_not_run_and_is_not_used_elsewhere():
    part = switch(Part.of(TREE), (1, 1)).part
    part = switch(insert(part, (0,), Part(Behavior("pick", ("B",))), "after").part, (1,)).part
    assert one_line(part.working.tree) == "Sequence(pick(A), Fallback(holding(A)), close_gripper)"
    assert set(part.unused) == {Behavior("open_gripper"), Behavior("pick", ("B",))}
    assert part.off_at == [1 + 1, 5, 6]
    again = insert(part, (0,), Part(Behavior("open_gripper")), "after").part
    assert Behavior("open_gripper") not in again.unused
    with pytest.raises(UserError, match="nothing would be left"):
        switch(Part.of(TREE), ())


def test_what_is_locked_is_one_leaf_with_a_name_of_its_own():
    part = lock(
        Part.of(parse_tree("Sequence(Fallback(holding(A), pick(A)), Fallback(holding(B), pick(B)))")), (0,)
    ).part
    part = lock(part, (1,)).part
    assert [leaf.name for leaf in leaves(part.tree)] == ["subtask", "subtask"]
    assert len({leaf.args[0] for leaf in leaves(part.tree)}) == 2
    with pytest.raises(UserError, match="never taken apart"):
        lock(Part.of(TREE), (0,))
    with pytest.raises(UserError, match="switched off"):
        lock(switch(Part.of(TREE), (1, 0)).part, (1,))
