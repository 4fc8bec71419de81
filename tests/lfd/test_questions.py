"""What demonstrations leave open: what is asked, and what an answer does."""

import dataclasses

import numpy as np
import pytest
from rich.console import Console

from bt_jax.commands.learn import show
from bt_jax.lfd import Corrections, Demonstrations, Frames, learn, open_questions
from bt_jax.lfd.evaluation.assessment import random_example
from bt_jax.lfd.evaluation.synthetic import demonstrate, with_boxes
from bt_jax.lfd.evaluation.synthetic_kits import demonstrate_kit
from bt_jax.lfd.question_words import answer_words, answered_words, question_words
from bt_jax.lfd.questions import answered, task_of
from bt_jax.lfd.rehearsal import parting, rehearse
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Layout, Target, load_task
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

SIDE_BY_SIDE = (
    Target("YellowBox", (-0.06, 0.0, 0.0525), "KittingBox"),
    Target("GreenBox", (0.06, 0.0, 0.0525), "KittingBox"),
)
BRIDGE = Target("BlueBox", (0.0, 0.0, 0.1525), "KittingBox")
IN_KIT = Target("BlueBox", (0.0, 0.0, 0.0525), "KittingBox")
KIT_STAYS = dataclasses.replace(STACK3, layout=dataclasses.replace(STACK3.layout, kit=STACK3.tables[0].name))
ASIDE = (Target("YellowBox", (-1.0, -0.64, 0.75), "base_link"), *STACKING[1:2], STACKING[0])
KIT4 = load_task("kit4")


def last_move(task, placements, *, count=3, seed=0, noise=0.0):
    """Demonstrations that begin where all but the last placement have been made, missing each by Gaussian noise [m]."""
    shown = [
        demonstrate(task, placements, rng=np.random.default_rng([seed, i]), noise=noise, name=f"demo{i + 1}")
        for i in range(count)
    ]
    whole = demonstrations(task, placements, count=1)
    cut = tuple(dataclasses.replace(one, actions=one.actions[-2:]) for one in shown)
    return Demonstrations(whole.frames, cut)


def packed(task, placements, *, count=3, seed=0, turn_noise=0.0):
    shown = [
        demonstrate_kit(
            task, placements, rng=np.random.default_rng([seed, i]), turn_noise=turn_noise, name=f"demo{i + 1}"
        )
        for i in range(count)
    ]
    return Demonstrations(Frames.of(task), tuple(shown))


def said(questions, lesson):
    return [question_words(question, lesson) for question in questions]


@pytest.mark.parametrize(
    ("placements", "frame", "text", "others"),
    [
        (
            STACKING,
            "GreenBox",
            "Should BlueBox follow GreenBox, YellowBox or its place in the kit?",
            ["YellowBox", "KittingBox"],
        ),
        (
            [*SIDE_BY_SIDE, BRIDGE],
            "KittingBox",
            "Should BlueBox follow its place in the kit, YellowBox or GreenBox?",
            ["YellowBox", "GreenBox"],
        ),
    ],
)
def test_a_tie_is_what_the_object_stands_on_and_a_question(placements, frame, text, others):
    lesson = learn(last_move(STACK3, placements), STACK3)
    place = lesson.inferences[-1]
    assert place.frame == place.candidates[0].frame == frame
    (asked,) = open_questions(lesson)
    assert (asked.kind, asked.subject, question_words(asked, lesson)) == ("frame", (1,), text)
    assert [answer.value for answer in asked.answers] == [frame, *others]


@pytest.mark.parametrize(("seed", "boxes"), [(6, 4), (26, 3)])
def test_every_answer_is_another_behavior_and_once_given_is_asked_no_more(seed, boxes):
    """The answers of a question part in some layout; the first is what is learnt meanwhile; each is learnt once it is kept,
    and taking it back brings back the question."""
    task = with_boxes(load_task("stack"), boxes)
    lesson = learn(random_example(task, seed=[0, seed], count=3, noise=0.005).demonstrations, task)
    layouts = sample_layouts(task, seed, 4)
    questions = open_questions(lesson, layouts)
    assert questions
    for question in questions:
        assert question.answers[0].lesson.tree == lesson.tree
        does = [rehearse(answer.lesson.tree, task_of(answer.lesson), layouts) for answer in question.answers]
        for i, one in enumerate(does):
            for other in does[:i]:
                assert max(parting(a, b, task) for a, b in zip(one, other, strict=True)) > 1
        for answer in question.answers:
            known = lesson.demonstrations
            kept = dataclasses.replace(known, corrections=known.corrections | answer.corrections)
            again = learn(kept, task)
            assert again.tree == answer.lesson.tree
            texts = said(open_questions(again, layouts), again)
            assert question_words(question, lesson) not in texts
            (what,) = answered(again)
            assert (what.kind, what.subject, what.value) == (question.kind, question.subject, answer.value)
            assert kept.corrections.without(what.corrections) == known.corrections


@pytest.mark.parametrize(
    ("task", "shown"),
    [
        (KIT_STAYS, last_move(KIT_STAYS, [IN_KIT])),  # in the kit or at a fixed place: the same in every layout
        (STACK3, demonstrations(STACK3, STACKING[:1])),
        (STACK3, last_move(STACK3, STACKING, count=2)),  # too few to infer anything
        (STACK3, demonstrations(STACK3, STACKING, noise=0.0, seed=3)),  # on what is itself put into the kit
    ],
    ids=["the kit stays", "no tie", "too few", "either way"],
)
def test_nothing_is_asked_that_makes_no_difference(task, shown):
    lesson = learn(shown, task)
    assert not [
        one
        for one in open_questions(lesson)
        if one.kind == "frame" and "base_link" not in [a.value for a in one.answers]
    ]
    assert task is not KIT_STAYS or open_questions(lesson) == ()


@pytest.mark.parametrize("noise", [0.002, 0.004])
@pytest.mark.parametrize("seed", range(3))
def test_poses_of_a_camera_or_a_hand_tie_as_exact_ones_do(noise, seed):
    lesson = learn(last_move(STACK3, STACKING, count=4, seed=seed, noise=noise), STACK3)
    assert lesson.inferences[-1].frame == "GreenBox"
    (asked,) = open_questions(lesson)
    assert asked.answers[0].value == "GreenBox"


def test_one_demonstration_more_answers():
    """With GreenBox on the table: it was GreenBox."""
    tied = last_move(STACK3, STACKING)
    elsewhere = demonstrate(STACK3, STACKING[2:], rng=np.random.default_rng(9), name="demo4")
    lesson = learn(dataclasses.replace(tied, demonstrations=(*tied.demonstrations, elsewhere)), STACK3)
    assert open_questions(lesson) == ()
    assert lesson.inferences[-1].frame == "GreenBox"
    assert len(lesson.inferences[-1].instances) == 4


def test_a_step_on_the_way_is_asked_for_until_four_demonstrations_show_it():
    """YellowBox is put aside, then GreenBox somewhere, then YellowBox into the kit."""
    green = Target("GreenBox", (-1.0, -1.36, 0.75), "base_link")
    placements = (ASIDE[0], green, STACKING[0])
    lesson = learn(demonstrations(STACK3, placements, seed=1), STACK3)
    (asked,) = open_questions(lesson, kinds=("step", "order"))
    assert question_words(asked, lesson) == "Is it meant that YellowBox is put on a table first?"
    meant, left_out = asked.answers
    assert len(rehearsed(meant.lesson)) == 3
    assert len(rehearsed(left_out.lesson)) == 2
    assert [answer_words("step", one.value, lesson) for one in asked.answers] == [
        "Yes, do that first",
        "No, leave it out",
    ]
    sure = learn(demonstrations(STACK3, placements, seed=1, count=4), STACK3)
    assert open_questions(sure, kinds=("step", "order")) == ()


def rehearsed(lesson):
    (done,) = rehearse(lesson.tree, task_of(lesson), sample_layouts(lesson.task, 5, 1))
    return done.moves


def test_a_turn_that_may_be_chance_is_asked_for():
    """Plate is turned by about 30 degrees, as far as a hasty hand does so."""
    loose = dataclasses.replace(KIT4, layout=Layout(kit=KIT4.layout.kit, turn=180.0), targets=())
    plate = Target("Plate", (-0.1, 0.0, 0.02), "Tray", 30.0)
    asked = []
    for seed in range(8):
        lesson = learn(packed(loose, [plate], seed=seed, turn_noise=6.0), loose)
        asked += [(lesson, one) for one in open_questions(lesson, kinds=("turn",))]
    assert asked
    for lesson, question in asked:
        assert "Should Plate lie turned by " in question_words(question, lesson)
        values = [answer.value for answer in question.answers]
        assert None in values
        for answer in question.answers:
            (place,) = [one for one in answer.lesson.inferences if one.kind == "place"]
            assert place.turn == answer.value


def test_an_instance_that_is_always_taken_is_asked_for():
    bolts = load_task("bolts")
    (place,) = [target for target in bolts.targets if target.slot == "TrayA.r1c1"]
    shown = [one for one in (packed(bolts, [place], count=1, seed=seed) for seed in range(60))]
    taken = [one for one in shown if one.demonstrations[0].things(one.frames)[0] == "Bolt2"][:3]
    same = Demonstrations(shown[0].frames, tuple(one.demonstrations[0] for one in taken))
    lesson = learn(same, bolts)
    (asked,) = open_questions(lesson)
    assert question_words(asked, lesson) == "There are six equal Bolts: Bolt2 and no other, or any?"
    anyone, itself = asked.answers
    assert (anyone.value, itself.value) == ("Bolt", "Bolt2")
    assert [move.thing for move in rehearsed(itself.lesson)] == [bolts.object_names.index("Bolt2")]
    kept = learn(dataclasses.replace(same, corrections=Corrections(itself={"Bolt2": True})), bolts)
    assert kept.targets == (dataclasses.replace(place, object="Bolt2"),)
    assert [answered_words(one, kept) for one in answered(kept)] == ["It has to be Bolt2."]


def test_the_command_prints_questions_and_answers():
    console = Console(record=True, width=200, highlight=False)
    tied = last_move(STACK3, STACKING)
    lesson = learn(tied, STACK3)
    show(console, lesson, open_questions(lesson))
    kept = Corrections(frames=dict.fromkeys(lesson.inferences[1].instances, "YellowBox"))
    show(console, learn(dataclasses.replace(tied, corrections=kept), STACK3), ())
    text = console.export_text()
    assert "question 1: Should BlueBox follow GreenBox, YellowBox or its place in the kit?" in text
    assert "1 Follow GreenBox   (taken meanwhile)" in text
    assert "2 Follow YellowBox   --answers 1=2" in text
    assert "answered 1: BlueBox follows YellowBox.   --take-back 1" in text
