import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, parse_behavior
from bt_jax.lfd.conflicts import conflict
from bt_jax.lfd.constraints import check_acyclic, orders, preconditions
from bt_jax.lfd.inference import Inference

steps = st.integers(2, 5).flatmap(lambda n: st.lists(st.permutations(range(n)), min_size=1, max_size=4))


def inferences(*texts):
    """Actions as if inferred, placed as written."""
    found = []
    for text in texts:
        one = parse_behavior(text)
        position = one.position or (0.0, 0.0, 0.0)
        found.append(Inference(one.name, one.object, one.frame or one.object, position, 0.0, (), (), ""))
        assert found[-1].behavior == one
    return found


BOXES = [f"Box{i}" for i in range(5)]
PICKS = inferences(*(f"pick({box})" for box in BOXES))


@given(shown=steps)
def test_orders_are_those_that_all_demonstrations_show(shown):
    expected = {
        (a, b) for a, b in itertools.permutations(shown[0], 2) if all(one.index(a) < one.index(b) for one in shown)
    }
    found = orders(shown)
    assert {(order.before, order.after) for order in found} == expected
    for order in found:
        assert order.seen == len(shown)
        assert order.distance == min(one.index(order.after) - one.index(order.before) for one in shown)
    check_acyclic(found, PICKS)


@given(shown=steps)
def test_one_reversed_observation_cancels_for_good(shown):
    assert orders([*shown, *([*reversed(one)] for one in shown)]) == ()
    assert orders([[0, 1, 0]]) == ()


def test_a_demonstration_without_both_says_nothing():
    (order,) = orders([[0, 1], [0], [1], []])
    assert (order.before, order.after, order.seen) == (0, 1, 1)


def test_a_circle_is_named():
    with pytest.raises(
        UserError, match=r"pick\(Box0\) before pick\(Box1\) before pick\(Box2\) before pick\(Box0\); delete"
    ):
        check_acyclic(orders([[0, 1], [1, 2], [2, 0]]), PICKS)


STACK = (
    "pick(Yellow)",
    "place(Yellow, (0, 0, 0.05), Kit)",
    "pick(Green)",
    "place(Green, (0, 0, 0.1), Yellow)",
)


def test_what_was_achieved_before_is_a_precondition():
    found = inferences(*STACK)
    shown = [[0, 1, 2, 3]] * 3
    extra = preconditions(orders(shown), found, shown)
    placed = Behavior("at", found[1].behavior.args)
    assert extra == {
        found[0].behavior: (),
        found[1].behavior: (),
        found[2].behavior: (placed,),
        found[3].behavior: (placed,),
    }


def test_without_an_order_there_is_no_precondition():
    found = inferences(*STACK)
    shown = [[0, 1, 2, 3], [2, 3, 0, 1]]
    assert set(preconditions(orders(shown), found, shown).values()) == {()}


def test_what_a_later_action_undoes_is_none():
    """Blue is put beside Green, which then goes away: Blue's place does not last, nor Green's first one."""
    found = inferences(
        "pick(Green)",
        "place(Green, (0, 0, 0), base)",
        "pick(Blue)",
        "place(Blue, (0.1, 0, 0), Green)",
        "pick(Green)",
        "place(Green, (0, 0, 0.05), Kit)",
        "pick(Yellow)",
    )
    shown = [list(range(7))] * 3
    extra = preconditions(orders(shown), found, shown)
    assert extra[found[3].behavior] == (Behavior("at", found[1].behavior.args),)
    assert extra[found[5].behavior] == ()
    assert extra[found[6].behavior] == (Behavior("at", found[5].behavior.args),)
    assert extra[found[4].behavior] == ()  # it holds the second time only


@given(shown=steps, places=st.lists(st.sampled_from(["base", *BOXES]), min_size=5, max_size=5))
def test_preconditions_can_hold_together(shown, places):
    found = inferences(
        *(
            f"place({box}, (0, 0, 0.1), {frame if frame != box else 'base'})"
            for box, frame in zip(BOXES, places, strict=True)
        )
    )
    for action, conditions in preconditions(orders(shown), found, shown).items():
        together = [*action.preconditions, *conditions]
        assert not any(conflict(a, b) for a in together for b in together)
