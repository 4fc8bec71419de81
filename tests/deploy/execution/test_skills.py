import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.settings import SIMULATED_TICK
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import FollowingLink, carried_out

TASK = load_task("yumi_stack")
PICK = parse_behavior("pick(YellowBox)")
PLACE = parse_behavior("place(YellowBox, (0, 0, 0.022), KittingBox)")


def at(x: float, y: float, turn: float = 0.0) -> RigidTransform:
    return RigidTransform.from_components([x, y, 0.02], Rotation.from_euler("z", turn))


@pytest.fixture
def link():
    kit = RigidTransform.from_translation([0.3, 0.0, 0.001])
    boxes = {"YellowBox": at(0.3, 0.24, 0.3), "GreenBox": at(0.3, -0.24), "BlueBox": at(0.33, -0.15)}
    return FollowingLink(TASK, boxes | {TASK.kits[0].name: kit})


@pytest.fixture
def skills(link):
    return RobotSkills(YUMI, TASK, link)


def once(when, what):
    """For `each`: does something once, as soon as `when()`."""
    done = []

    def each():
        if not done and when():
            done.append(what())

    return each


def test_a_box_is_picked_and_put_where_it_should_be(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    assert link.seen().holding == "YellowBox"
    assert link.boxes["YellowBox"].translation[2] > 0.08
    assert carried_out(skills, link, PLACE) == Status.SUCCESS
    goal = link.boxes[TASK.kits[0].name].apply([0, 0, 0.022])
    assert np.linalg.norm(link.boxes["YellowBox"].translation - goal) < 0.0015
    assert link.seen().holding is None


def test_a_box_that_is_moved_meanwhile_is_followed(link, skills):
    def move():
        link.boxes["YellowBox"] = at(0.26, 0.2)

    each = once(lambda: link.arm("left").moving and link.time > 0.5, move)
    assert carried_out(skills, link, PICK, each=each) == Status.SUCCESS, skills.reason
    assert link.halted
    assert link.seen().holding == "YellowBox"


def test_what_comes_into_the_way_has_the_way_planned_again(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS

    def push():
        link.boxes["GreenBox"] = at(0.3, 0.12)

    started = link.time
    each = once(lambda: link.arm("left").moving and link.time > started + 0.3, push)
    assert carried_out(skills, link, PLACE, seconds=started + 60, each=each) == Status.SUCCESS, skills.reason
    assert "left" in link.halted


def test_a_box_goes_where_the_kit_is_now(link, skills):
    """The kit is moved while the right arm goes home, before there is a plan for the left one."""
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    link.joints["right"][0] += 0.3
    started = link.time
    moved = RigidTransform.from_translation([0.31, 0.015, 0.001])
    each = once(lambda: link.arm("right").moving and link.time > started, lambda: link.boxes.update(KittingBox=moved))
    assert carried_out(skills, link, PLACE, seconds=started + 60, each=each) == Status.SUCCESS, skills.reason
    assert np.linalg.norm(link.boxes["YellowBox"].translation - moved.apply([0, 0, 0.022])) < 0.0015


def test_nothing_is_put_down_where_something_was_once(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    link.hidden.add(TASK.kits[0].name)
    assert carried_out(skills, link, PLACE) == Status.FAILURE
    assert "KittingBox is not seen" in skills.reason
    assert link.seen().holding == "YellowBox"


def test_what_was_out_of_sight_is_waited_for_and_looked_at_again(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    link.hidden.add(TASK.kits[0].name)
    moved = RigidTransform.from_translation([0.31, 0.06, 0.001])
    link.boxes[TASK.kits[0].name] = moved
    at_home = lambda: np.abs(link.joints["left"] - YUMI.home["left"]).max() < 0.05  # noqa: E731
    assert carried_out(skills, link, PLACE, each=once(at_home, link.hidden.clear)) == Status.SUCCESS, skills.reason
    assert np.linalg.norm(link.boxes["YellowBox"].translation - moved.apply([0, 0, 0.022])) < 0.0015


@pytest.mark.parametrize("back", [False, True])
def test_nothing_is_put_where_a_frame_is_missing_on_the_way(link, skills, back):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    began, kit = link.time, TASK.kits[0].name

    def take():
        link.hidden.add(kit)
        link.missing.add(kit)

    def put_back():
        link.boxes[kit] = RigidTransform.from_translation([0.31, 0.05, 0.001])
        link.hidden.clear()
        link.missing.clear()

    def is_looked_for():
        return back and kit in link.hidden and np.abs(link.joints["left"] - YUMI.home["left"]).max() < 0.05

    taken = once(lambda: link.arm("left").moving and link.time > began + 0.3, take)
    returned = once(is_looked_for, put_back)
    status = carried_out(skills, link, PLACE, seconds=began + 60, each=lambda: (taken(), returned()))
    if back:
        assert status == Status.SUCCESS, skills.reason
        goal = link.boxes[kit].apply([0, 0, 0.022])
        assert np.linalg.norm(link.boxes["YellowBox"].translation - goal) < 0.0015
    else:
        assert (status, skills.reason) == (Status.FAILURE, "KittingBox is not seen")
        assert link.seen().holding == "YellowBox"


def test_a_hand_does_not_close_where_a_box_is_missing(link, skills):
    def take():
        link.boxes["YellowBox"] = at(2.0, 0.0)
        link.hidden.add("YellowBox")
        link.missing.add("YellowBox")

    each = once(lambda: link.arm("left").moving and link.time > 0.5, take)
    assert carried_out(skills, link, PICK, each=each) == Status.FAILURE
    assert skills.reason == "YellowBox is not seen"
    assert all(opening > 0.04 for _, opening in link.grips)


def descends(link, place):
    """Is the left hand straight above a place, and low?"""
    tip = YUMI.forward("left", link.joints["left"]).translation
    return link.arm("left").moving and np.linalg.norm(tip[:2] - place) < 0.003 and tip[2] < 0.08


def test_a_box_that_leaves_under_the_descending_hand_is_followed(link, skills):
    each = once(lambda: descends(link, [0.3, 0.24]), lambda: link.boxes.update(YellowBox=at(0.3, 0.21, 0.3)))
    assert carried_out(skills, link, PICK, each=each) == Status.SUCCESS, skills.reason
    assert "left" in link.halted
    opened = ("left", YUMI.arm("left").gripper.opening)
    assert link.grips.count(opened) == 2, "one approach was broken off before the fingers closed"


def test_a_box_that_seems_to_wander_under_the_hand_is_grasped(link, skills):
    each = once(lambda: descends(link, [0.3, 0.24]), lambda: link.boxes.update(YellowBox=at(0.302, 0.244, 0.3)))
    assert carried_out(skills, link, PICK, each=each) == Status.SUCCESS, skills.reason
    assert not link.halted


def test_the_way_home_is_planned_again_around_what_comes_into_it(link, skills):
    link.joints["left"] = YUMI.home["left"] + 0.3
    skills.look()
    for _ in range(200):
        if skills.poll(link.seen()) != Status.RUNNING:
            break
        if link.time > 0.25:
            link.boxes["GreenBox"] = at(0.3, 0.1)
        link.wait(link.time + 0.1)
    assert link.halted == ["left"]
    assert np.abs(link.joints["left"] - YUMI.home["left"]).max() < 0.05


def test_a_box_that_slipped_out_is_no_longer_carried_after_a_look(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    skills.look()
    assert skills.grasped == {"left": "YellowBox"}

    def slip():
        del link.held["left"]
        link.boxes["YellowBox"] = at(0.3, 0.24)

    started = link.time
    each = once(lambda: link.arm("left").moving and link.time > started + 0.3, slip)
    assert carried_out(skills, link, PLACE, seconds=started + 60, each=each) == Status.FAILURE
    link.wait(link.time + 1.0)
    skills.poll(link.seen())
    skills.look()
    assert skills.grasped == {}


def test_where_one_arm_finds_no_way_home_it_is_the_one_that_picks(link, skills, monkeypatch):
    link.boxes["YellowBox"] = at(0.3, 0.1)
    link.joints["right"][0] += 0.3

    def home(arm, *_):
        raise Unplannable(f"the {arm} arm finds no way home")

    monkeypatch.setattr(skills._moves.planner, "home", home)
    assert carried_out(skills, link, PICK) == Status.SUCCESS, skills.reason
    assert link.held["right"][0] == "YellowBox"


@pytest.mark.parametrize("place", [(0.3, -0.46), (0.35, -0.45)])
def test_a_box_is_set_down_where_both_arms_reach_it_though_that_is_far(place):
    """Tables so far apart that the nearest places are the right arm's alone."""
    apart = [
        dataclasses.replace(table, position=(table.position[0], 1.75 * table.position[1], table.position[2]))
        for table in TASK.tables
    ]
    task = dataclasses.replace(TASK, tables=tuple(apart))
    kit = RigidTransform.from_translation([0.3, 0.42, 0.001])
    link = FollowingLink(task, {"YellowBox": at(*place), TASK.kits[0].name: kit})
    skills = RobotSkills(YUMI, task, link)
    assert carried_out(skills, link, PICK) == Status.SUCCESS, skills.reason
    assert link.held["right"][0] == "YellowBox"
    assert carried_out(skills, link, PLACE) == Status.SUCCESS, skills.reason
    assert carried_out(skills, link, PICK, seconds=120) == Status.SUCCESS, skills.reason
    assert link.held["left"][0] == "YellowBox"


def test_an_arm_that_is_halted_has_not_arrived(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    started = link.time
    each = once(lambda: link.arm("left").moving and link.time > started + 0.3, lambda: link.halt("left"))
    assert carried_out(skills, link, PLACE, seconds=started + 60, each=each) == Status.FAILURE
    assert "halted" in skills.reason
    assert link.seen().holding == "YellowBox"


def test_fingers_that_close_on_nothing_are_a_failure(link, skills):
    def vanish():
        link.boxes["YellowBox"] = at(0.25, -0.3)

    gone = once(lambda: skills.committed, vanish)
    assert carried_out(skills, link, PICK, each=gone) == Status.FAILURE
    assert "nothing" in skills.reason
    assert link.openings["left"] == pytest.approx(YUMI.arm("left").gripper.opening, abs=0.002)


@pytest.mark.parametrize("delay", [0.2, 0.6, 1.0])
def test_slow_readings_of_the_fingers_are_no_grasp(link, skills, monkeypatch, delay):
    """Fingers that tell where they were some time ago."""
    told = []
    true_arm = FollowingLink.arm

    def late(self, arm):
        state = true_arm(self, arm)
        told.append((self.time, arm, state.opening))
        old = [o for t, a, o in told if a == arm and t <= self.time - delay]
        return dataclasses.replace(state, opening=old[-1] if old else state.opening)

    monkeypatch.setattr(FollowingLink, "arm", late)
    lifted_open = []
    each = lambda: lifted_open.append(  # noqa: E731
        skills.committed and link.arm("left").moving and link.openings["left"] > 0.045
    )
    assert carried_out(skills, link, PICK, each=each) == Status.SUCCESS, skills.reason
    assert not any(lifted_open)
    assert carried_out(skills, link, PLACE) == Status.SUCCESS, skills.reason


def test_fingers_that_do_not_close_are_no_missing_box(link, skills, monkeypatch):
    monkeypatch.setattr(FollowingLink, "_move_fingers", lambda self, arm: None)
    assert carried_out(skills, link, PICK) == Status.FAILURE
    assert "the left fingers did not close: they are still 50 mm apart" in skills.reason


def test_something_of_another_width_between_the_fingers_is_told(link, skills):
    link.size = 0.033
    assert carried_out(skills, link, PICK) == Status.FAILURE
    assert "closed on something 33 mm wide that is not YellowBox" in skills.reason


def test_a_box_that_turns_under_the_descending_hand_is_followed(link, skills):
    each = once(lambda: descends(link, [0.3, 0.24]), lambda: link.boxes.update(YellowBox=at(0.3, 0.24, 0.7)))
    assert carried_out(skills, link, PICK, each=each) == Status.SUCCESS, skills.reason
    assert "left" in link.halted
    assert np.abs(link.held["left"][1].rotation.as_matrix()).round(2).max(axis=0).min() == 1.0, (
        "edges along the fingers"
    )


def test_a_box_that_is_seen_elsewhere_leaves_something_unknown_in_the_fingers(link, skills):
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    started, true_seen = link.time, link.seen

    def seen():
        told = true_seen()
        away = {"YellowBox": at(0.3, 0.24)} if link.time > started + 1.0 else {}
        return dataclasses.replace(told, poses={**told.poses, **away}, holding=None if away else told.holding)

    link.seen = seen
    assert carried_out(skills, link, PLACE, seconds=started + 60) == Status.FAILURE
    assert "something unknown is between the left fingers" in skills.reason


@pytest.mark.parametrize("keep", [False, True])
def test_arms_that_a_stop_left_with_a_box_come_home_without_it_or_with_it(link, keep):
    before = RobotSkills(YUMI, TASK, link)
    assert carried_out(before, link, PICK) == Status.SUCCESS
    arm, box = next((arm, box) for arm, (box, _) in link.held.items())
    fresh = RobotSkills(YUMI, TASK, link)  # of another process, that knows nothing of the grasp
    for known in (link.seen(), dataclasses.replace(link.seen(), poses={})):  # with and without a camera
        fresh.recover(keep=keep)
        height, heights = link.boxes[box].translation[2], []
        while (status := fresh.poll(dataclasses.replace(known, time=link.time))) == Status.RUNNING:
            heights.append(float(YUMI.forward(arm, link.joints[arm]).translation[2]))
            link.wait(link.time + 0.1)
        assert status == Status.SUCCESS, fresh.reason
        assert (arm in link.held) == keep
        assert all(np.abs(link.joints[each] - YUMI.home[each]).max() < 0.06 for each in YUMI.arm_names)
        assert keep or link.boxes[box].translation[2] == height, "it was let go of where it was"
        assert min(heights) > heights[0] - 0.005, "first up, then home"


def test_fingers_that_do_not_open_take_along_what_they_hold(link, skills, monkeypatch):
    """What the robot believes to hold stays what it holds, so that the tree places it again."""
    assert carried_out(skills, link, PICK) == Status.SUCCESS
    with monkeypatch.context() as jammed:
        jammed.setattr(FollowingLink, "_move_fingers", lambda self, arm: None)
        assert carried_out(skills, link, PLACE, seconds=120) == Status.FAILURE
    assert skills.fault == "jam"
    assert skills.grasped == {"left": "YellowBox"}
    assert link.boxes["YellowBox"].translation[2] > 0.08
    assert carried_out(skills, link, PLACE, seconds=180) == Status.SUCCESS, skills.reason
    goal = link.boxes[TASK.kits[0].name].apply([0, 0, 0.022])
    assert np.linalg.norm(link.boxes["YellowBox"].translation - goal) < 0.0015


def test_an_attempt_that_fails_says_which_fault_it_was(link, skills):
    gone = once(lambda: skills.committed, lambda: link.boxes.update(YellowBox=at(0.25, -0.3)))
    assert carried_out(skills, link, PICK, each=gone) == Status.FAILURE
    assert skills.fault == "slip"
    assert carried_out(skills, link, PICK, seconds=120) == Status.SUCCESS, skills.reason

    def fall():
        del link.held[next(iter(link.held))]
        link.boxes["YellowBox"] = at(0.3, 0.1)

    lost = once(lambda: link.time > started + 1, fall)
    started = link.time
    assert carried_out(skills, link, PLACE, seconds=started + 60, each=lost) == Status.FAILURE
    assert skills.fault == "drop", skills.reason
    link.hidden.add(TASK.kits[0].name)
    assert carried_out(skills, link, PICK, seconds=started + 180) == Status.SUCCESS
    assert carried_out(skills, link, PLACE, seconds=started + 240) == Status.FAILURE
    assert "not seen" in skills.reason
    assert skills.fault == ""


def test_a_look_waits_as_long_as_it_may_in_the_simulation(link, skills):
    """An object that is out of sight for three ticks of the simulation is waited for."""
    link.hidden.add("YellowBox")
    back = once(lambda: link.time > 3 * SIMULATED_TICK, link.hidden.clear)
    assert carried_out(skills, link, parse_behavior("look(YellowBox)"), each=back) == Status.SUCCESS, skills.reason
    assert not link.grips
