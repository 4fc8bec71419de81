"""Demonstrations that put something elsewhere than the others."""

import dataclasses

import numpy as np
import pytest

from bt_jax.lfd import learn
from bt_jax.lfd.disagreement import Disagreement, agreed_place, disagreements
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task

TASK = load_task("stack")
ON_YELLOW, BESIDE = Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox"), Target("GreenBox", (0.0, 0.25, 0.0), "YellowBox")


def taught(*groups):
    """What is learnt from groups of demonstrations, each a number of them and their targets."""
    rng, shown = np.random.default_rng(3), []
    for count, *targets in groups:
        demonstrations = demonstration_set(TASK, targets, count=count, rng=rng)
        shown += demonstrations.demonstrations
    named = tuple(dataclasses.replace(one, name=f"demo{i + 1}") for i, one in enumerate(shown))
    return learn(dataclasses.replace(demonstrations, demonstrations=named), TASK)


def test_one_that_puts_an_object_elsewhere_is_named_with_how_far():
    lesson = taught((3, ON_YELLOW), (1, BESIDE))
    (found,) = disagreements(lesson)
    assert found == Disagreement("demo4", "GreenBox", "YellowBox", found.away, 3)
    assert found.away == pytest.approx(np.hypot(0.25, 0.1), abs=0.01)
    assert agreed_place(lesson, "GreenBox").frame == "YellowBox"


def test_demonstrations_that_agree_are_left_in_peace():
    assert disagreements(taught((4, ON_YELLOW))) == ()


def test_two_ways_that_are_shown_often_are_no_mistake():
    assert disagreements(taught((3, ON_YELLOW), (3, BESIDE))) == ()


def test_too_few_tell_nothing():
    lesson = taught((1, ON_YELLOW), (1, BESIDE))
    assert (disagreements(lesson), agreed_place(lesson, "GreenBox")) == ((), None)


def test_an_object_that_only_some_move_twice_disagrees_nowhere():
    aside = Target("BlueBox", (0.3, 0.0, 0.05), "KittingBox")
    assert disagreements(taught((3, ON_YELLOW), (1, ON_YELLOW, aside))) == ()
