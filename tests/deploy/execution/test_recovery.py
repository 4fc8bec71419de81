"""What arms that a stop has left somewhere take home, what they keep clear of, and what prevents it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.recovery import between
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.planning.grasps import grasp_poses
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import TICK, FollowingLink

TASK = load_task("yumi_stack")
AWAY = np.array([0.2, -0.1, 0.1, 0.0, 0.0, 0.0, 0.0])
STANDING = RigidTransform.from_translation([0.3, -0.24, 0.02])


def left_by_a_stop(**openings):
    link = FollowingLink(TASK, {"YellowBox": STANDING})
    for arm in link.arms:
        link.joints[arm] = link.joints[arm] + AWAY
        link.openings[arm] = link.targets[arm] = openings.get(arm, link.openings[arm])
    skills = RobotSkills(YUMI, TASK, link)
    skills._moves.take(link.seen())
    return link, skills


def recovered(link, skills, *, keep):
    skills.recover(keep=keep)
    while link.time < 60.0:
        status = skills.poll(link.seen())
        if status != Status.RUNNING:
            return status
        link.wait(link.time + TICK)
    raise AssertionError("still running")


@pytest.mark.parametrize("opening", [0.04, 0.046, 0.03])
def test_what_is_not_seen_in_the_fingers_is_carried_and_takes_no_obstacle_away(opening):
    link, skills = left_by_a_stop(left=opening)
    assert recovered(link, skills, keep=True) == Status.SUCCESS, skills.reason
    moves = skills._moves
    assert set(moves.carried) == {"left"}
    assert not moves.carried["left"].known
    assert "YellowBox" in moves.obstacles(), "it stands where it is seen"
    assert skills.grasped == {}


def test_the_box_that_is_seen_in_the_fingers_is_the_one_that_is_carried():
    link, skills = left_by_a_stop(left=0.04)
    link.boxes["BlueBox"] = YUMI.forward("left", link.joints["left"])
    assert recovered(link, skills, keep=True) == Status.SUCCESS, skills.reason
    assert skills.grasped == {"left": "BlueBox"}
    assert set(skills._moves.obstacles()) == {"YellowBox"}


def test_a_box_that_stands_where_something_unknown_is_carried_is_in_the_way():
    _, skills = left_by_a_stop(left=0.04)
    moves = skills._moves
    carried = between(moves, "left")
    there = YUMI.forward("left", moves.joints()["left"])
    moves.planner._clearance.place({carried.box: there}, carried=carried)
    assert moves.planner._clearance.distance(moves.joints()) < 0


def test_open_and_closed_fingers_hold_nothing():
    for opening in (0.0, YUMI.arm("left").gripper.opening):
        _, skills = left_by_a_stop(left=opening)
        assert between(skills._moves, "left") is None


def test_one_arm_at_most_takes_something_along():
    link, skills = left_by_a_stop(left=0.04, right=0.04)
    assert recovered(link, skills, keep=True) == Status.FAILURE
    assert "left and right" in skills.reason
    assert link.motions == {"left": 0, "right": 0}


def test_fingers_that_do_not_open_keep_the_arms_where_they_are():
    link, skills = left_by_a_stop(left=0.04)
    link._move_fingers = lambda arm: None
    assert recovered(link, skills, keep=False) == Status.FAILURE
    assert "the left fingers do not move" in skills.reason
    assert link.motions == {"left": 0, "right": 0}


def test_an_arm_rises_straight_up_before_it_goes_home():
    link, skills = left_by_a_stop()
    low = grasp_poses(RigidTransform.from_translation([0.3, 0.24, 0.06]), TASK.objects[0], 0.05)
    found = (ArmKinematics(YUMI, "left").solve(pose, YUMI.home["left"]) for pose in low)
    link.joints["left"] = [joints for joints in found if joints is not None][1]
    places, wait = [], link.wait

    def watched(until):
        wait(until)
        places.append(YUMI.forward("left", link.joints["left"]).translation)

    link.wait = watched
    start = YUMI.forward("left", link.joints["left"]).translation
    assert recovered(link, skills, keep=False) == Status.SUCCESS, skills.reason
    places = np.array(places)
    up = np.linalg.norm(places[:, :2] - start[:2], axis=1) < 0.003
    assert places[up, 2].max() > start[2] + 0.05
    assert places[:, 2].min() > start[2] - 0.003
    assert np.abs(link.joints["left"] - YUMI.home["left"]).max() < 0.05
