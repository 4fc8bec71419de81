import dataclasses
import itertools

import pytest
from rich.console import Console

from bt_jax.commands.learn import show
from bt_jax.lfd import learn
from bt_jax.lfd.explanation import order_sentences, precondition_sentences
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations


@pytest.mark.parametrize(
    ("count", "said"), [(1, "the one demonstration that has both"), (3, "all 3 demonstrations that have both")]
)
def test_an_order_says_in_how_many_demonstrations_it_was_seen(count, said):
    shown = demonstrations(STACK3, STACKING)
    lesson = learn(dataclasses.replace(shown, demonstrations=shown.demonstrations[:count]), STACK3)
    sentences = [sentence for one in lesson.subtasks for sentence in order_sentences(lesson, one)]
    assert sentences
    assert all(sentence.endswith(said) for sentence in sentences)


def test_orders_and_preconditions_that_follow_from_others_are_left_out():
    (one,) = (lesson := learn(demonstrations(STACK3, STACKING), STACK3)).subtasks
    names = [target.object for target in STACKING]
    following = list(itertools.pairwise(names))
    orders = order_sentences(lesson, one, say=lambda action: action.object)
    assert [tuple(sentence.split(":")[0].split(" before ")) for sentence in orders] == following
    waits = precondition_sentences(one, say=lambda action: action.object)
    assert sorted(tuple(reversed(sentence.split(" waits for "))) for sentence in waits) == sorted(following)


def test_one_demonstration_is_said_in_the_singular():
    shown = demonstrations(STACK3, STACKING)
    console = Console(record=True, width=200, highlight=False)
    show(console, learn(dataclasses.replace(shown, demonstrations=shown.demonstrations[:1]), STACK3), ())
    assert "1 demonstration: " in console.export_text()
