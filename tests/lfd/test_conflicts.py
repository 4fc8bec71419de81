from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, Kind, parse_behavior
from bt_jax.lfd.conflicts import conflict, implies, undoes
from tests.helpers.strategies import ATOMS

PLACES = [
    Behavior(name, (thing, (0.0, 0.0, 0.1), frame))
    for name in ("at", "place")
    for thing in ("YellowBox", "GreenBox")
    for frame in ("BlueBox", "base_link")
]
BEHAVIORS = [*ATOMS, *PLACES]
conditions = st.sampled_from([one for one in BEHAVIORS if one.kind == Kind.CONDITION])
actions = st.sampled_from([one for one in BEHAVIORS if one.kind == Kind.ACTION])


def both(a, b):
    return parse_behavior(a), parse_behavior(b)


@given(a=conditions, b=conditions)
def test_conflicts_are_mutual(a, b):
    assert conflict(a, b) == conflict(b, a)


@given(a=conditions, b=conditions)
def test_what_follows_does_not_conflict(a, b):
    assert not conflict(a, a)
    if implies(a, b):
        assert not conflict(a, b)


@given(a=conditions, b=conditions, c=conditions)
def test_what_excludes_a_consequence_excludes_its_cause(a, b, c):
    if implies(a, b) and conflict(b, c):
        assert conflict(a, c)


@given(action=actions)
def test_no_action_undoes_what_it_achieves(action):
    for a in action.postconditions:
        assert not undoes(action, a)
        for b in action.postconditions:
            assert not conflict(a, b)


@given(action=actions, condition=conditions)
def test_what_excludes_an_achievement_is_undone(action, condition):
    if any(conflict(post, condition) for post in action.postconditions):
        assert undoes(action, condition)


def test_conflicts():
    assert conflict(*both("holding(YellowBox)", "holding(nothing)"))
    assert conflict(*both("holding(YellowBox)", "holding(GreenBox)"))
    assert conflict(*both("holding(YellowBox)", "gripper(open)"))
    assert conflict(*both("gripper(closed)", "gripper(open)"))
    assert conflict(*both("at(YellowBox, (0, 0, 1), GreenBox)", "at(YellowBox, (0, 0, 1), KittingBox)"))
    assert conflict(*both("holding(YellowBox)", "at(YellowBox, (0, 0, 1), GreenBox)"))
    assert not conflict(*both("holding(YellowBox)", "at(BlueBox, (0, 0, 1), GreenBox)"))
    assert not conflict(*both("holding(nothing)", "at(BlueBox, (0, 0, 1), GreenBox)"))
    assert not conflict(*both("holding(YellowBox)", "gripper(closed)"))
    assert not conflict(*both("holding(nothing)", "gripper(open)"))
    assert not conflict(*both("at(YellowBox, (0, 0, 1), GreenBox)", "at(BlueBox, (0, 0, 1), GreenBox)"))


def test_a_moved_frame_takes_its_places_along():
    assert undoes(*both("pick(GreenBox)", "at(YellowBox, (0, 0, 1), GreenBox)"))
    assert undoes(*both("pick(YellowBox)", "at(YellowBox, (0, 0, 1), GreenBox)"))
    assert undoes(*both("place(YellowBox, (0, 0, 2), GreenBox)", "at(YellowBox, (0, 0, 1), GreenBox)"))
    assert not undoes(*both("pick(BlueBox)", "at(YellowBox, (0, 0, 1), GreenBox)"))
    assert undoes(*both("pick(BlueBox)", "gripper(open)"))
    assert undoes(*both("open_gripper", "holding(BlueBox)"))


@given(action=actions, a=conditions, b=conditions, parts=st.sets(st.sampled_from(["YellowBox", "GreenBox"])))
def test_interchangeable_objects_conflict_less(action, a, b, parts):
    assert conflict(a, b, parts=parts) == conflict(b, a, parts=parts) <= conflict(a, b)
    assert undoes(action, a, parts=parts) <= undoes(action, a)
    if not parts & {a.object, b.object, action.object}:
        assert conflict(a, b, parts=parts) == conflict(a, b)
        assert undoes(action, a, parts=parts) == undoes(action, a)


def test_one_instance_of_a_part_leaves_the_others_where_they_are():
    there = "at(Bolt, (0, 0, 1), Tray)"
    assert not conflict(*both(there, "at(Bolt, (0, 1, 1), Tray)"), parts={"Bolt"})
    assert not conflict(*both(there, "holding(Bolt)"), parts={"Bolt"})
    assert not undoes(*both("pick(Bolt)", there), parts={"Bolt"})
    assert not undoes(*both("place(Bolt, (0, 1, 1), Tray)", there), parts={"Bolt"})
    assert undoes(*both("pick(Tray)", there), parts={"Bolt"})
    assert conflict(*both("holding(Bolt)", "holding(Plate)"), parts={"Bolt"})
    assert conflict(*both("holding(Bolt)", "gripper(open)"), parts={"Bolt"})
