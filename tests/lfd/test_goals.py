from hypothesis import given
from hypothesis import strategies as st

from bt_jax.behaviors import Behavior, parse_behavior
from bt_jax.lfd.conflicts import conflict, undoes
from bt_jax.lfd.demonstration import Demonstrations
from bt_jax.lfd.goals import goal_of, sequences, subtasks
from bt_jax.lfd.inference import infer
from tests.helpers.demonstrations import STACK3, STACKING, at, demonstrations

BOXES = ("YellowBox", "GreenBox", "BlueBox")
NOTHING = Behavior("holding", ("nothing",))


@st.composite
def moves(draw):
    """Picks and places as a demonstration has them."""
    actions = []
    for _ in range(draw(st.integers(1, 6))):
        thing = draw(st.sampled_from(BOXES))
        frame = draw(st.sampled_from([name for name in (*BOXES, "KittingBox", "base_link") if name != thing]))
        place = (thing, (0.0, 0.0, draw(st.sampled_from([0.05, 0.1]))), frame)
        actions += [Behavior("pick", (thing,)), Behavior("place", place)]
    return actions


@given(actions=moves())
def test_a_goal_is_what_still_holds(actions):
    """The oracle keeps a state from the first action to the last."""
    state = []
    for action in actions:
        state = [one for one in state if one not in action.postconditions and not undoes(action, one)]
        state += action.postconditions
    goal = goal_of(actions)
    assert set(goal) == set(state)
    assert not any(conflict(a, b) for a in goal for b in goal)
    assert [one for one in goal if one.name == "at"] == [one for one in state if one.name == "at"]


def test_an_object_counts_where_it_was_left_last():
    actions = ["pick(YellowBox)", "place(YellowBox, (0, 0, 0.1), base_link)"]
    actions += ["pick(YellowBox)", "place(YellowBox, (0, 0, 0.2), KittingBox)"]
    assert goal_of([parse_behavior(one) for one in actions]) == (at("YellowBox", (0, 0, 0.2), "KittingBox"), NOTHING)


def test_other_goals_are_other_subtasks():
    there = demonstrations(STACK3, STACKING[:2], noise=0.0)
    on_blue = demonstrations(STACK3, [STACKING[2], STACKING[0]], seed=1, noise=0.0)
    mixed = Demonstrations(there.frames, (*there.demonstrations, *on_blue.demonstrations))
    inferences = infer(mixed, STACK3)
    steps = sequences(mixed, inferences)
    found = subtasks(inferences, steps, [one.things(mixed.frames) for one in mixed])
    assert [len(one) for one in steps] == [4] * 6
    assert sorted(d for one in found for d in one.demonstrations) == list(range(6))
    assert len(found) >= 2
    for one in found:
        for d in one.demonstrations:
            assert set(goal_of([inferences[step].behavior for step in steps[d]])) == set(one.goal)


def test_the_order_in_which_a_goal_comes_true_does_not_matter():
    first = demonstrations(STACK3, [STACKING[0], STACKING[2]], noise=0.0)
    other = demonstrations(STACK3, [STACKING[2], STACKING[0]], seed=1, noise=0.0)
    mixed = Demonstrations(first.frames, (*first.demonstrations, *other.demonstrations))
    inferences = infer(mixed, STACK3)
    things = [one.things(mixed.frames) for one in mixed]
    (one,) = subtasks(inferences, sequences(mixed, inferences), things)
    assert one.demonstrations == tuple(range(6))
    expected = {at("YellowBox", (0, 0, 0.052), "KittingBox"), at("BlueBox", (0, 0, 0.1), "GreenBox"), NOTHING}
    assert set(one.goal) == expected
