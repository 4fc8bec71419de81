import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior
from bt_jax.encoding.arrays import violations
from bt_jax.encoding.walk import leaves
from bt_jax.lfd import Action, DemonstrationFolder, Demonstrations, Pose, learn, open_questions
from bt_jax.lfd.question_words import question_words
from bt_jax.mjx_env.episodes.rules import Ending
from bt_jax.tasks import Target, load_task, with_subgoal
from tests.helpers.demonstrations import (
    RESTACK,
    STACK3,
    STACKING,
    UNSTACKING,
    at,
    demonstrations,
    one_demonstration,
    run,
)

PUBLISHED = Path(__file__).parents[3] / "shared/reference/demonstrations"
needs_published = pytest.mark.skipif(
    not PUBLISHED.is_dir(), reason="the published demonstrations are not beside this checkout"
)


@needs_published
def test_the_published_stack():
    """YellowBox is the published frame. It tied with GreenBox, on which BlueBox was put, and the kit."""
    lesson = learn(DemonstrationFolder(PUBLISHED / "stack").read(), load_task("stack"))
    assert lesson.tree == Behavior("move", ("BlueBox", (0.0, -0.001, 0.118), "GreenBox"))
    assert lesson.missing == 0
    assert lesson.targets == (Target("BlueBox", (0.0, -0.001, 0.118), "GreenBox"),)
    place = lesson.inferences[1]
    assert place.tied == ("KittingBox", "YellowBox")
    assert place.tolerance == pytest.approx(0.0125, abs=0.001)
    assert place.candidates[0].frame == "GreenBox"
    assert place.candidates[-1].frame == "base_link"
    (asked,) = open_questions(lesson, kinds=("frame",))
    assert question_words(asked, lesson) == "Should BlueBox follow GreenBox, YellowBox or its place in the kit?"
    published = learn(DemonstrationFolder(PUBLISHED / "stack").read(), load_task("stack"), frames={1: "YellowBox"})
    assert published.targets == (Target("BlueBox", (0.0, -0.001, 0.218), "YellowBox"),)


@needs_published
def test_the_published_pyramid():
    """GreenBox stands on two boxes, so that none of them is preferred, and the first of the recorded frames is taken."""
    lesson = learn(DemonstrationFolder(PUBLISHED / "pyramid").read(), load_task("pyramid"))
    assert lesson.targets == (Target("GreenBox", (-0.062, 0.002, 0.157), "KittingBox"),)
    assert lesson.inferences[1].tied == ("YellowBox", "BlueBox")
    (asked,) = open_questions(lesson, kinds=("frame",))
    assert {answer.value for answer in asked.answers} == {"KittingBox", "YellowBox", "BlueBox"}


@pytest.mark.parametrize("seed", range(8))
def test_demonstrated_stacking_works(seed):
    lesson = learn(demonstrations(STACK3, STACKING, seed=seed, noise=0.007), STACK3)
    assert violations(lesson.tree) == []
    assert run(lesson.tree, STACK3, seed=seed, max_ticks=15).solved
    assert [target.object for target in lesson.targets] == ["YellowBox", "GreenBox", "BlueBox"]
    assert set(lesson.genes) >= {Behavior("move", place.args) for place in lesson.placements}


@pytest.mark.parametrize("seed", range(4))
def test_demonstrated_restacking_works(seed):
    """Three demonstrations of experiment 3 solve it in layouts that were not shown."""
    lesson = learn(demonstrations(RESTACK, (*UNSTACKING, *STACKING), seed=seed), RESTACK)
    assert violations(lesson.tree) == []
    for layout in range(3):
        assert run(lesson.tree, RESTACK, seed=layout, max_ticks=15).solved


@pytest.mark.parametrize("count", [1, 2])
def test_few_demonstrations_of_unstacking_are_about_fixed_places(count):
    lesson = learn(demonstrations(RESTACK, UNSTACKING, count=count), RESTACK)
    assert lesson.missing == 3 - count
    assert [place.frame for place in lesson.placements] == ["base_link", "base_link"]
    gene = lesson.subtask_gene("freed")
    played = run(gene, RESTACK)
    assert played.ending == Ending.SUCCESS
    assert played.final.reached.all()
    assert [tick.command.name for tick in played.ticks if tick.command] == ["pick", "place"] * 2
    assert Behavior("reached", ("unstacked",)) in leaves(gene.subtree)


@pytest.mark.parametrize("rule", ["seen", "ticked"])
def test_a_new_subgoal_is_added_to_the_task_and_guards_its_gene(rule):
    plain = dataclasses.replace(RESTACK, subgoals=(), subgoal_reward=rule)
    lesson = learn(demonstrations(plain, UNSTACKING, count=1), plain)
    gene = lesson.subtask_gene("freed")
    assert Behavior("reached", ("freed",)) in leaves(gene.subtree)
    played = run(gene, with_subgoal(plain, lesson.subgoal("freed"), source="demonstrations"))
    assert played.ending == Ending.SUCCESS
    assert played.final.reached.all()


def test_one_demonstration_of_restacking_repeats_it():
    shown = demonstrations(RESTACK, (*UNSTACKING, *STACKING), count=1)
    lesson = learn(shown, RESTACK)
    (at_robot,) = {place.frame for place in lesson.placements}
    assert at_robot == "base_link"
    assert len(lesson.placements) == 3


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 4))
def test_learning_is_deterministic_and_loses_nothing(seed, count):
    shown = demonstrations(RESTACK, (*UNSTACKING, *STACKING), seed=seed, count=count, noise=0.01)
    lesson = learn(shown, RESTACK)
    assert learn(shown, RESTACK) == lesson
    assert [len(steps) for steps in lesson.steps] == [len(one.actions) for one in shown]
    assert {place.object for place in lesson.placements} == set(RESTACK.object_names)
    assert violations(lesson.tree) == []


def test_several_goals_are_alternatives():
    there, elsewhere = STACKING[0], Target("YellowBox", (-1.0, -0.64, 0.75), "base_link")
    one, other = (demonstrations(STACK3, [place], seed=i) for i, place in enumerate((there, elsewhere)))
    lesson = learn(Demonstrations(one.frames, (*one.demonstrations, *other.demonstrations)), STACK3)
    assert len(lesson.subtasks) == 2
    assert sorted(place.frame for place in lesson.placements) == ["KittingBox", "base_link"]
    assert run(lesson.tree, STACK3).ending == Ending.SUCCESS
    with pytest.raises(UserError, match=r"in 2 different ways.*; learn from those that agree"):
        _ = lesson.targets


def test_contradicting_orders_are_named():
    """No demonstration contradicts itself, and no two each other, but all three together do."""
    places = [Target(box, (0.133 * i, 0.0, 0.052), "KittingBox") for i, box in enumerate(STACK3.object_names)]
    pairs = [(0, 1), (1, 2), (2, 0)]
    shown = [demonstrations(STACK3, [places[a], places[b]], count=4, seed=a) for a, b in pairs]
    mixed = Demonstrations(shown[0].frames, tuple(one for each in shown for one in each))
    lesson = learn(mixed, STACK3)
    assert len(lesson.subtasks) == 3  # three goals, each with its own order


def with_pick_of(task, name):
    """A demonstration that picks what it must not."""
    frames = (task.kits[0].name, *task.object_names, task.robot_frame)
    poses = {frame: Pose((0.0, 0.0, 0.12) if frame == name else (1.0, 1.0, 1.0)) for frame in frames}
    return dataclasses.replace(one_demonstration(task), actions=(Action("pick", poses), Action("place", poses)))


def test_a_pick_of_a_fixture_is_left_out():
    good = demonstrations(STACK3, STACKING)
    bad = dataclasses.replace(with_pick_of(STACK3, "KittingBox"), name="demo4")
    lesson = learn(dataclasses.replace(good, demonstrations=(*good.demonstrations, bad)), STACK3)
    assert lesson.tree == learn(good, STACK3).tree
    assert lesson.demonstrations.problems == (
        "demo4 is left out: it picks KittingBox, which the robot cannot move; record it again.",
    )
    with pytest.raises(UserError, match="demo4 is left out: it picks KittingBox"):
        learn(Demonstrations(good.frames, (bad,)), STACK3)


@pytest.mark.parametrize(
    ("names", "robot", "message"),
    [
        (("PinkBox", *STACK3.frames), "base_link", "have a frame 'PinkBox' that task stack3 has not; use one of"),
        (STACK3.frames[1:], "base_link", "lack the frame YellowBox of task stack3; record them"),
        (STACK3.frames, "KittingBox", "the robot's frame is KittingBox in the demonstrations and base_link"),
    ],
)
def test_frames_of_another_task_are_named(names, robot, message):
    shown = demonstrations(STACK3, STACKING)
    frames = dataclasses.replace(shown.frames, names=tuple(names), robot=robot)
    with pytest.raises(UserError, match=message):
        learn(dataclasses.replace(shown, frames=frames), STACK3)


def test_targets_have_the_height_of_the_object():
    """What is recorded is the end effector, 0.12 m above."""
    shown = demonstrations(STACK3, STACKING[:1], noise=0.0)
    assert shown.demonstrations[0].actions[1].poses["KittingBox"].position[2] == pytest.approx(0.172)
    np.testing.assert_allclose(learn(shown, STACK3).targets[0].position, (0, 0, 0.052), atol=1e-9)
    assert learn(shown, STACK3).placements == (at("YellowBox", (0, 0, 0.052), "KittingBox"),)
