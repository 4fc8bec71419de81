import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import FIRST_LEAF, Control, Kind, Symbol, Vocabulary
from bt_jax.encoding import decode, draw_text, encode, leaves, tick_tree, to_svg, violations
from bt_jax.encoding.status import Status

DOOR_OPEN, KNOCK, ENTER = (
    Symbol(name, kind) for name, kind in (("door_open", Kind.CONDITION), ("knock", Kind.ACTION), ("enter", Kind.ACTION))
)
TREE = Control.sequence(Control.fallback(DOOR_OPEN, KNOCK), ENTER)


def test_symbols_of_any_domain_become_arrays_and_come_back():
    vocabulary = Vocabulary.of([KNOCK, DOOR_OPEN, ENTER, KNOCK])
    assert vocabulary.leaves == (DOOR_OPEN, KNOCK, ENTER)
    trees = encode(TREE, vocabulary, 8)
    assert trees.tokens.tolist() == [1, 2, FIRST_LEAF, FIRST_LEAF + 1, FIRST_LEAF + 2, 0, 0, 0]
    assert decode(trees, vocabulary) == TREE
    assert violations(TREE) == []
    assert violations(Control.sequence(KNOCK, DOOR_OPEN)) == [
        "the condition door_open directly follows knock",
        "the condition door_open is the last child",
    ]


def test_symbols_are_ticked_and_drawn():
    assert str(TREE) == repr(TREE) == "Sequence(Fallback(door_open, knock), enter)"
    assert leaves(TREE) == [DOOR_OPEN, KNOCK, ENTER]
    ticked = tick_tree(TREE, lambda leaf, _: Status.RUNNING if leaf == ENTER else Status.SUCCESS)
    assert ticked.statuses == (Status.RUNNING, Status.SUCCESS, Status.SUCCESS, None, Status.RUNNING)
    assert draw_text(TREE).splitlines()[1:] == ["├── ?", "│   ├── door_open", "│   └── knock", "└── enter"]
    assert "door_open" in to_svg(TREE)


def test_leaves_that_look_alike_are_refused():
    with pytest.raises(UserError, match="two different behaviors are called 'knock'"):
        Vocabulary.of([KNOCK, Symbol("knock", Kind.CONDITION)])
    for kind in (Kind.PAD, Kind.SEQUENCE, Kind.FALLBACK):
        with pytest.raises(UserError, match="make it a CONDITION"):
            Vocabulary.of([KNOCK, Symbol("other", kind)])
    with pytest.raises(UserError, match="knock is not in the vocabulary"):
        Vocabulary.of([ENTER]).token(KNOCK)
