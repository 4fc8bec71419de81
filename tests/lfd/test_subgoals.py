import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bt_jax.behaviors import Behavior
from bt_jax.lfd import Action, Demonstration, Demonstrations, Frames, Pose, learn
from bt_jax.lfd.evaluation.synthetic_kits import demonstrate_kit
from bt_jax.lfd.placements import condition_of
from bt_jax.lfd.subgoals import derive_subgoal
from bt_jax.mjx_env.conditions import holding_subgoals
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.tasks import Subgoal, load_task
from tests.helpers.demonstrations import RESTACK, STACK3, STACKING, UNSTACKING, at, demonstrations

STACKED = dataclasses.replace(RESTACK, subgoals=())
BOLTS = load_task("bolts")


@pytest.mark.parametrize("count", [1, 2, 3])
def test_a_subgoal_of_the_task_that_is_reached_is_that_one(count):
    lesson = learn(demonstrations(RESTACK, UNSTACKING, count=count), RESTACK)
    assert lesson.subgoal("mine") == RESTACK.subgoals[0]
    gene = lesson.subtask_gene("mine")
    assert gene.args[0] == "mine"
    assert str(gene.subtree.children[0]) == "reached(unstacked)"


@pytest.mark.parametrize(
    ("conditions", "shown"),
    [
        (["at(GreenBox, (0, 0, 0.1), BlueBox)"], False),  # only at the start
        (["clear(GreenBox)"], False),  # at the start already
        (["clear(YellowBox)", "holding(GreenBox)"], False),
        (["clear(YellowBox)", "gripper(open)", "reachable(GreenBox)"], True),
    ],
)
def test_a_subgoal_of_the_task_is_reached_if_it_holds_at_the_end_and_not_at_the_start(conditions, shown):
    task = dataclasses.replace(RESTACK, subgoals=(Subgoal("own", tuple(conditions)),))
    lesson = learn(demonstrations(task, UNSTACKING), task)
    assert lesson.subgoal("mine").name == ("own" if shown else "mine")


def test_a_place_is_a_subgoal_of_the_task():
    (one, *_) = STACKING
    place = str(at(one.object, one.position, one.frame))
    task = dataclasses.replace(STACK3, subgoals=(Subgoal("own", (place,)),))
    assert learn(demonstrations(task, STACKING), task).subgoal("mine").name == "own"


@pytest.mark.parametrize("count", [1, 2, 3])
def test_unstacking_frees_what_was_under(count):
    lesson = learn(demonstrations(STACKED, UNSTACKING, count=count), STACKED)
    subgoal = lesson.subgoal("freed")
    assert subgoal.name == "freed"
    assert subgoal.conditions == ("clear(YellowBox)", "clear(BlueBox)", "holding(nothing)")


def test_stacking_is_about_the_places():
    lesson = learn(demonstrations(STACK3, STACKING), STACK3)
    subgoal = lesson.subgoal("stacked")
    assert subgoal.conditions == (*map(str, lesson.placements), "holding(nothing)")


def test_the_scene_knows_when_it_is_reached():
    """Boxes that start apart are free; stacked ones are not."""
    lesson = learn(demonstrations(STACKED, UNSTACKING, count=1), STACKED)
    subgoals = (lesson.subgoal("freed"),)
    stacked = dataclasses.replace(STACKED, subgoals=subgoals)
    apart = dataclasses.replace(STACK3, subgoals=subgoals)
    assert not np.any(holding_subgoals(stacked, sample_layouts(stacked, 0, 5)))
    assert np.all(holding_subgoals(apart, sample_layouts(apart, 0, 5)))


def test_the_orientation_of_the_gripper_does_not_matter():
    straight = demonstrations(RESTACK, UNSTACKING, noise=0.0)
    rng = np.random.default_rng(0)

    def turned(action):
        turn = Rotation.from_euler("z", rng.uniform(-3, 3))
        quaternion = tuple(turn.as_quat(scalar_first=True).tolist())
        return Action(action.kind, {name: Pose(pose.position, quaternion) for name, pose in action.poses.items()})

    tilted = Demonstrations(
        straight.frames,
        tuple(Demonstration(one.name, tuple(map(turned, one.actions))) for one in straight),
    )
    goal = (at("GreenBox", UNSTACKING[0].position, "base_link"),)
    for task in (RESTACK, STACKED):
        assert derive_subgoal("freed", tilted, goal, task) == derive_subgoal("freed", straight, goal, task)


@pytest.mark.parametrize(
    ("condition", "shown"),
    [
        (condition_of(BOLTS.targets[0]), True),
        (condition_of(BOLTS.targets[1]), False),  # nobody put one there
        (Behavior("clear", ("Bolt",)), False),  # at the start already
    ],
)
def test_a_condition_on_a_part_holds_if_it_does_for_any_instance(condition, shown):
    task = dataclasses.replace(BOLTS, subgoals=(Subgoal("own", (str(condition),)),))
    made = tuple(demonstrate_kit(task, task.targets[:1], rng=np.random.default_rng(d)) for d in range(3))
    lesson = learn(Demonstrations(Frames.of(task), made), task)
    assert lesson.subgoal("mine").name == ("own" if shown else "mine")
