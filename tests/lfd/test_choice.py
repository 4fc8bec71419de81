"""Frames that a person chooses."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.lfd import Corrections, Instance, learn
from bt_jax.tasks import Target
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations, run

ON_GREEN = Target("BlueBox", (0.0, 0.0, 0.1), "GreenBox")


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 4))
def test_a_chosen_frame_is_the_mean_of_what_was_shown_there(seed, count):
    shown = demonstrations(STACK3, STACKING, seed=seed, count=count)
    for index, inference in enumerate(learn(shown, STACK3).inferences):
        if inference.kind == "pick":
            continue
        for frame in shown.frames.names:
            if frame == inference.object:
                continue
            chosen = next(
                one
                for one in learn(shown, STACK3, frames={index: frame}).inferences
                if inference.instances[0] in one.instances and one.kind == "place"
            )
            points = [shown.demonstrations[m.demonstration].actions[m.index].handled(frame) for m in chosen.instances]
            assert chosen.frame == frame
            assert chosen.chosen
            assert "chosen by hand" in chosen.reason
            np.testing.assert_allclose(chosen.position, np.mean(points, axis=0), atol=6e-4)
            reach = max(np.linalg.norm(point - np.mean(points, axis=0)) for point in points)
            assert chosen.tolerance == pytest.approx(reach)


def test_choosing_what_was_inferred_changes_no_tree():
    shown = demonstrations(STACK3, STACKING)
    lesson = learn(shown, STACK3)
    same = {i: one.frame for i, one in enumerate(lesson.inferences) if one.kind == "place"}
    assert learn(shown, STACK3, frames=same).tree == lesson.tree
    assert learn(shown, STACK3, frames={}) == lesson


def test_one_demonstration_and_a_choice_are_enough():
    """Without the choice, the place is a fixed one, and the tree works in that layout only."""
    shown = demonstrations(STACK3, [ON_GREEN], count=1, noise=0.0)
    assert learn(shown, STACK3).placements[0].frame == "base_link"
    lesson = learn(shown, STACK3, frames={1: "GreenBox"})
    assert lesson.targets == (ON_GREEN,)
    for layout in range(5):
        played = run(lesson.tree, dataclasses.replace(STACK3, targets=(ON_GREEN,)), seed=layout)
        assert played.solved


def test_two_demonstrations_become_one_place_in_the_chosen_frame():
    shown = demonstrations(STACK3, [ON_GREEN], count=2)
    apart = learn(shown, STACK3)
    assert [one.kind for one in apart.inferences] == ["pick", "place", "place"]
    assert len(apart.subtasks) == 2
    together = learn(shown, STACK3, frames={1: "GreenBox", 2: "GreenBox"})
    assert [one.kind for one in together.inferences] == ["pick", "place"]
    assert together.inferences[1].instances == (Instance(0, 1), Instance(1, 1))
    assert len(together.subtasks) == 1


def test_the_choice_kept_in_the_demonstrations_is_the_same():
    shown = demonstrations(STACK3, STACKING)
    lesson = learn(shown, STACK3)
    said = Corrections(frames={lesson.inferences[1].instances[2]: "base_link"})
    kept = dataclasses.replace(shown, corrections=said)
    assert learn(kept, STACK3).inferences == learn(shown, STACK3, frames={1: "base_link"}).inferences


@pytest.mark.parametrize(
    ("frames", "remedy"),
    [
        ({0: "GreenBox"}, "a pick is always relative to its object; choose a frame for a place"),
        ({1: "YellowBox"}, "a place of YellowBox cannot be in the frame 'YellowBox'; choose KittingBox, "),
        ({1: "PinkBox"}, "cannot be in the frame 'PinkBox'; choose"),
        ({9: "GreenBox"}, "no action 10 to choose a frame for; choose one from 1 to 6"),
    ],
)
def test_what_cannot_be_chosen_is_said(frames, remedy):
    with pytest.raises(UserError, match=remedy):
        learn(demonstrations(STACK3, STACKING), STACK3, frames=frames)
