"""Frames, goals and orders are recognized in random sets of demonstrations; the benchmark `demonstrations` has more."""

import dataclasses

import numpy as np
import pytest

from bt_jax.behaviors import Behavior
from bt_jax.lfd import learn
from bt_jax.lfd.evaluation.assessment import assess, random_example, situations_example, tells_apart
from bt_jax.lfd.evaluation.synthetic import on_one_table, with_boxes
from tests.helpers.demonstrations import STACK3


def example_of(seed, count):
    rng = np.random.default_rng(seed)
    task = with_boxes(STACK3, int(rng.integers(2, 7)))
    return random_example(task, seed=[seed], count=count, noise=rng.uniform(0.005, 0.01), reorder=bool(seed % 2))


def rates(counts, sets):
    """Share of placements whose frame is right, strictly and leniently, and of sets with right goal and order."""
    found = []
    for count in counts:
        for seed in range(sets):
            example = example_of(seed, count)
            found.append(assess(learn(example.demonstrations, example.task), example))
    placements = sum(one.placements for one in found)
    strict, lenient = sum(one.strict for one in found), sum(one.lenient for one in found)
    return strict / placements, lenient / placements, np.mean([one.goal and one.order for one in found])


def test_a_few_random_sets_are_recognized():
    strict, lenient, sets = rates((3, 5), 10)
    assert strict >= 0.8
    assert lenient >= 0.99
    assert sets >= 0.95  # 19 of 20


def situations_of(seed, count):
    rng = np.random.default_rng(seed)
    task = with_boxes(STACK3, int(rng.integers(3, 7)))
    return situations_example(on_one_table(task) if seed % 2 else task, seed=[seed], count=count, noise=0.005)


@pytest.mark.parametrize("count", [3, 5])
def test_two_situations_are_told_apart(count):
    """The same box goes to a place in one frame, or to one in another."""
    for seed in range(6):
        example = situations_of(seed, count)
        assert tells_apart(learn(example.demonstrations, example.task), example)


def test_situations_that_are_mixed_up_are_noticed():
    example = situations_of(0, 3)
    lesson = learn(example.demonstrations, example.task)
    places = [i for i, one in enumerate(lesson.inferences) if one.kind == "place"]
    for i in places:
        parts = list(lesson.inferences)
        parts[i] = dataclasses.replace(parts[i], instances=parts[i].instances[1:])
        assert not tells_apart(dataclasses.replace(lesson, inferences=tuple(parts)), example)


@pytest.mark.slow
def test_random_sets_are_recognized():
    strict, lenient, sets = rates((4, 10), 40)
    assert strict >= 0.85
    assert lenient >= 0.99
    assert sets >= 0.98


def test_without_noise_all_is_recognized():
    for seed in range(10):
        example = example_of(seed, 4)
        result = assess(learn(example.exact, example.task), dataclasses.replace(example, demonstrations=example.exact))
        assert result.lenient == result.placements
        assert result.goal
        assert result.order


def test_mistakes_are_noticed():
    """What is learnt from other demonstrations is wrong for these."""
    example = example_of(2, 4)
    lesson = learn(example.demonstrations, example.task)
    right = assess(lesson, example)
    assert right.lenient == right.placements
    final = [Behavior("place", place.args) for place in lesson.placements]
    place = next(one for one in lesson.inferences if one.behavior in final)

    def with_place(**changes):
        wrong = dataclasses.replace(place, **changes)
        inferences = tuple(wrong if one is place else one for one in lesson.inferences)
        return assess(dataclasses.replace(lesson, inferences=inferences), example)

    still = next(name for name in example.task.frames if name not in (place.frame, place.object))
    assert not with_place(position=(9.0, 9.0, 9.0)).goal
    assert with_place(frame=still).strict < right.placements
    subtask = lesson.subtasks[0]
    assert not assess(dataclasses.replace(lesson, subtasks=(subtask, subtask)), example).goal
    without = dataclasses.replace(subtask, constraints=())
    assert right.order
    assert len(example.shown[0]) == 1 or not assess(dataclasses.replace(lesson, subtasks=(without,)), example).order
