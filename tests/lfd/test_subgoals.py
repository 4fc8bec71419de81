import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bt_jax.lfd import Action, Demonstration, Demonstrations, Pose, learn
from bt_jax.lfd.subgoals import derive_subgoal
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import see_subgoals
from tests.helpers.demonstrations import RESTACK, STACK3, STACKING, UNSTACKING, at, demonstrations


@pytest.mark.parametrize("count", [1, 2, 3])
def test_unstacking_frees_what_was_under(count):
    lesson = learn(demonstrations(RESTACK, UNSTACKING, count=count), RESTACK)
    subgoal = lesson.subgoal("freed")
    assert subgoal.name == "freed"
    assert subgoal.conditions == ("clear(YellowBox)", "clear(BlueBox)", "holding(nothing)")


def test_stacking_is_about_the_places():
    lesson = learn(demonstrations(STACK3, STACKING), STACK3)
    subgoal = lesson.subgoal("stacked")
    assert subgoal.conditions == (*map(str, lesson.placements), "holding(nothing)")


def test_the_scene_knows_when_it_is_reached():
    """Boxes that start apart are free; stacked ones are not."""
    lesson = learn(demonstrations(RESTACK, UNSTACKING, count=1), RESTACK)
    subgoals = (lesson.subgoal("freed"),)
    stacked = dataclasses.replace(RESTACK, subgoals=subgoals)
    apart = dataclasses.replace(STACK3, subgoals=subgoals)
    assert not np.any(see_subgoals(stacked, sample_layouts(stacked, 0, 5)))
    assert np.all(see_subgoals(apart, sample_layouts(apart, 0, 5)))


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
    assert derive_subgoal("freed", tilted, goal, RESTACK) == derive_subgoal("freed", straight, goal, RESTACK)
