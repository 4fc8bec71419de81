import functools
import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Kind, expand, parse_behavior
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import learn
from bt_jax.lfd.conflicts import conflict, undoes
from bt_jax.lfd.constraints import check_acyclic, orders, preconditions
from bt_jax.lfd.evaluation.assessment import random_example, situations_example
from bt_jax.lfd.evaluation.synthetic import with_boxes
from bt_jax.lfd.inference import Inference
from tests.helpers.demonstrations import STACK3

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


def things(found, shown):
    """What each action handles, where no part leaves a choice."""
    return [[found[step].object for step in sequence] for sequence in shown]


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
    extra = preconditions(orders(shown), found, shown, things(found, shown))
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
    assert set(preconditions(orders(shown), found, shown, things(found, shown)).values()) == {()}


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
    extra = preconditions(orders(shown), found, shown, things(found, shown))
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
    for action, conditions in preconditions(orders(shown), found, shown, things(found, shown)).items():
        together = [*action.preconditions, *conditions]
        assert not any(conflict(a, b) for a in together for b in together)
        assert not any(undoes(action, condition) for condition in conditions)


def test_what_an_action_undoes_itself_is_none():
    """Blue is put beside Green, and Green goes away: while Green hangs in the gripper, nothing is beside it."""
    found = inferences(
        "pick(Blue)", "place(Blue, (0.12, 0, 0), Green)", "pick(Green)", "place(Green, (0, 0, 0.05), Kit)"
    )
    shown = [list(range(4))] * 3
    assert set(preconditions(orders(shown), found, shown, things(found, shown)).values()) == {()}


def contradictions(tree):
    """Conditions beyond an action's own that stand before it in a Sequence, and that it undoes."""
    if isinstance(tree, Behavior):
        return []
    found = [one for child in tree.children for one in contradictions(child)]
    if tree.kind == Kind.SEQUENCE:
        for i, action in enumerate(tree.children):
            if isinstance(action, Behavior) and action.kind == Kind.ACTION:
                before = [leaves(child)[0] for child in tree.children[:i]]
                extra = [one for one in before if one.kind == Kind.CONDITION and one not in action.preconditions]
                found += [(action, one) for one in extra if undoes(action, one)]
    return found


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 3), situations=st.booleans())
def test_no_learnt_tree_has_a_precondition_that_its_action_contradicts(seed, count, situations):
    task = with_boxes(STACK3, 3 + seed % 2)
    make = situations_example if situations else functools.partial(random_example, reorder=bool(seed % 2))
    lesson = learn(make(task, seed=[seed], count=count, noise=0.005).demonstrations, task)
    assert contradictions(expand(lesson.tree)) == []
    for one in lesson.subtasks:
        for action, conditions in one.preconditions.items():
            assert not any(undoes(action, condition) for condition in conditions)
            assert not any(conflict(a, b) for a in action.preconditions for b in conditions)
