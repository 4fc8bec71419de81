"""Where frames tie: what is taken, and what is asked."""

import dataclasses

import numpy as np
import pytest
from rich.console import Console

from bt_jax.commands.learn import show
from bt_jax.lfd import Demonstrations, learn
from bt_jax.lfd.evaluation.synthetic import demonstrate
from bt_jax.tasks import Target
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

SIDE_BY_SIDE = (
    Target("YellowBox", (-0.06, 0.0, 0.0525), "KittingBox"),
    Target("GreenBox", (0.06, 0.0, 0.0525), "KittingBox"),
)
BRIDGE = Target("BlueBox", (0.0, 0.0, 0.1525), "KittingBox")
KIT_STAYS = dataclasses.replace(STACK3, layout=dataclasses.replace(STACK3.layout, kit=STACK3.tables[0].name))


def last_move(task, placements, *, count=3, seed=0, noise=0.0):
    """Demonstrations that begin where all but the last placement have been made, missing each by Gaussian noise [m]."""
    shown = [
        demonstrate(task, placements, rng=np.random.default_rng([seed, i]), noise=noise, name=f"demo{i + 1}")
        for i in range(count)
    ]
    whole = demonstrations(task, placements, count=1)
    cut = tuple(dataclasses.replace(one, actions=one.actions[-2:]) for one in shown)
    return Demonstrations(whole.frames, cut)


@pytest.mark.parametrize(
    ("task", "placements", "frame", "question", "settled_by"),
    [
        (
            STACK3,
            STACKING,
            "GreenBox",
            "Should BlueBox follow GreenBox, or YellowBox, or its place in the kit?",
            "show it once with GreenBox elsewhere",
        ),
        (
            STACK3,
            [*SIDE_BY_SIDE, BRIDGE],
            "KittingBox",
            "Should BlueBox follow its place in the kit, or YellowBox, or GreenBox?",
            "show it once with the kit elsewhere",
        ),
        (
            KIT_STAYS,
            [Target("BlueBox", (0.0, 0.0, 0.0525), "KittingBox")],
            "KittingBox",
            "Should BlueBox follow its place in the kit, or stay at a fixed place?",
            None,
        ),
        (
            KIT_STAYS,
            [Target("BlueBox", (0.9, -1.0, 0.75), "base_link")],
            "base_link",
            "Should BlueBox follow its place in the kit, or stay at a fixed place?",
            None,
        ),
    ],
)
def test_a_tie_is_what_the_object_stands_on_and_a_question(task, placements, frame, question, settled_by):
    lesson = learn(last_move(task, placements), task)
    place = lesson.inferences[-1]
    assert place.frame == frame
    assert place.candidates[0].frame == frame
    (asked,) = lesson.questions
    assert (asked.action, asked.object) == (1, "BlueBox")
    assert asked.alternatives[0] == frame
    assert set(asked.alternatives[1:]) == set(place.tied)
    assert (asked.text, asked.settled_by) == (question, settled_by)


@pytest.mark.parametrize("noise", [0.002, 0.004])
@pytest.mark.parametrize("seed", range(5))
def test_poses_of_a_camera_or_a_hand_tie_as_exact_ones_do(noise, seed):
    lesson = learn(last_move(STACK3, STACKING, count=4, seed=seed, noise=noise), STACK3)
    assert lesson.inferences[-1].frame == "GreenBox"
    (asked,) = lesson.questions
    assert asked.alternatives[0] == "GreenBox"


def test_what_settles_a_question_does():
    """One demonstration more, with GreenBox on the table: it was GreenBox."""
    tied = last_move(STACK3, STACKING)
    elsewhere = demonstrate(STACK3, STACKING[2:], rng=np.random.default_rng(9), name="demo4")
    lesson = learn(dataclasses.replace(tied, demonstrations=(*tied.demonstrations, elsewhere)), STACK3)
    assert lesson.questions == ()
    assert lesson.inferences[-1].frame == "GreenBox"
    assert len(lesson.inferences[-1].instances) == 4


def test_a_choice_answers_a_question():
    tied = last_move(STACK3, STACKING)
    (asked,) = learn(tied, STACK3).questions
    for frame in asked.alternatives:
        lesson = learn(tied, STACK3, frames={asked.action: frame})
        assert lesson.questions == ()
        assert lesson.placements[0].frame == frame


def test_without_a_tie_nothing_is_asked():
    assert learn(demonstrations(STACK3, STACKING[:1]), STACK3).questions == ()
    assert learn(last_move(STACK3, STACKING, count=2), STACK3).questions == ()


def test_the_command_offers_no_remedy_that_is_impossible():
    console = Console(record=True, width=200, highlight=False)
    show(console, learn(last_move(KIT_STAYS, [Target("BlueBox", (0.0, 0.0, 0.0525), "KittingBox")]), KIT_STAYS))
    assert "say another frame, as with --frames 2=base_link\n" in console.export_text()


def test_the_command_prints_the_question():
    console = Console(record=True, width=200, highlight=False)
    show(console, learn(last_move(STACK3, STACKING), STACK3))
    said = console.export_text()
    assert "Should BlueBox follow GreenBox, or YellowBox, or its place in the kit?" in said
    assert (
        "GreenBox is taken; say another frame, as with --frames 2=YellowBox, or show it once with GreenBox elsewhere"
        in said
    )
