"""What leaves the link in each state; and whatever happens, no setpoint that is not finite, more than one step from the one
before, out of bounds, or too sudden."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.safety import Rejected, check_trajectory
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.planning.trajectory import HALT, Trajectory
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.servo import SetpointFilter
from bt_jax.deploy.twin.settings import Realism
from tests.helpers.cells import smooth
from tests.helpers.guided import FAR, HERE, RULES, GuidedCell
from tests.helpers.hostile import EPISODE, play


def test_the_first_setpoint_is_measured_three_times():
    cell = GuidedCell(start=False)
    assert cell.cycle() is None, "nobody has agreed to motion"
    cell.guidance.begin_answering()
    assert cell.cycle() is None
    assert cell.cycle() is None
    np.testing.assert_array_equal(cell.cycle(), HERE)


@pytest.mark.parametrize("bad", [np.radians(170.0), np.nan, np.inf, -np.inf, 0.2])
def test_what_is_measured_once_is_never_a_setpoint(bad):
    cell = GuidedCell(start=False)
    cell.guidance.begin_answering()
    wrong = HERE.copy()
    wrong[1] = bad
    for joints in (None, None, wrong, None, None, wrong, wrong):
        assert cell.cycle(joints) is None
    assert cell.guidance.enable(cell.time) is not None
    for _ in range(2):
        assert cell.cycle() is None
    np.testing.assert_array_equal(cell.cycle(), HERE)


def test_where_no_arm_can_be_nothing_begins():
    cell = GuidedCell(start=False)
    cell.guidance.begin_answering()
    wrong = HERE.copy()
    wrong[1] = np.radians(170.0)
    assert all(cell.cycle(wrong) is None for _ in range(20))


@pytest.mark.parametrize("lag", [1, 50])
def test_a_stop_comes_to_rest_on_the_path_however_late_the_arm_follows(lag):
    cell = GuidedCell(lag=lag)
    cell.follow()
    cell.run(1.0)
    before = len(cell.sent)
    cell.supervisor.stop("somebody shouted")
    cell.run(1.0)
    speeds = cell.speeds(before - 2)
    assert speeds[0] > 0.5
    assert np.all(np.diff(speeds) <= 1e-9), "speed only falls"
    assert np.all(np.abs(np.diff(speeds)) <= 10.0 * CYCLE + 1e-9)
    assert not cell.arm.moving
    assert np.ptp(np.array(cell.sent[-100:]), axis=0).max() == 0, "then it holds"
    assert round(HALT / CYCLE) == pytest.approx(np.count_nonzero(speeds[2:]), abs=3)
    assert np.ptp(cell.sent[-1]) < 1e-9, "on the path all joints are alike"


def test_a_blocked_arm_is_not_pulled_to_where_it_is_held():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.7)
    cell.measured = cell.sent[-1]
    cell.run(1.5)
    assert "holds it" in cell.supervisor.reason
    rest = cell.sent[-1]
    assert rest[0] > cell.measured[0] + RULES.lag
    cell.run(1.0)
    np.testing.assert_array_equal(cell.sent[-1], rest)


def test_an_arm_that_is_held_is_not_pushed_for_long():
    cell = GuidedCell()
    cell.measured = HERE
    cell.follow(HERE + 0.5, seconds=5.0)  # at up to 0.19 rad/s
    while cell.supervisor.reason is None:
        cell.cycle()
    assert "holds it" in cell.supervisor.reason
    assert np.abs(cell.sent[-1] - HERE).max() < np.radians(8.0)


def test_an_arm_that_is_pushed_away_at_rest_stops_also_where_it_came_from():
    cell = GuidedCell()
    cell.follow(seconds=1.0)
    cell.run(1.0 + 1.5 * RULES.response)
    assert not cell.arm.moving
    assert cell.supervisor.reason is None
    cell.measured = FAR - 1.1 * RULES.lag
    cell.cycle()
    assert "holds it" in cell.supervisor.reason


@pytest.mark.parametrize("factor", [1.0, 1.5, 3.0])
def test_an_arm_that_is_held_by_nothing_is_not_stopped_however_late_and_fast(factor):
    arm = YUMI.arm("left")
    here, there = YUMI.home["left"], YUMI.home["left"] + np.array([0.6, 0.5, -0.6, -0.5, 0.6, 0.5, 0.6])
    wide = dataclasses.replace(RULES, lower=(-4.0,) * 7, upper=(4.0,) * 7, speed=tuple(arm.speed))
    rules = dataclasses.replace(wide, acceleration=tuple(arm.acceleration))
    servo, cell = SetpointFilter(Realism().scaled(factor), here), GuidedCell(rules, here=here)
    for goal in (there, here):
        path = timed(np.stack([cell.sent[-1], goal]), Pace(share=1.0, acceleration=1.0, tool=5.0), arm)
        assert cell.guidance.follow("left", path.times, path.joints, 1) is None
        while cell.arm.moving:
            servo.take(cell.cycle(), cell.time)
            cell.measured = servo.advance(cell.time)
    assert cell.supervisor.reason is None
    assert np.abs(path.speeds()).max() > 1.5


@pytest.mark.parametrize("corrupt", [np.radians(170.0), np.nan])
def test_a_corrupt_measurement_stops_without_a_step(corrupt):
    cell = GuidedCell()
    cell.follow()
    cell.run(1.0)
    before, wrong = len(cell.sent), cell.sent[-1].copy()
    wrong[1] = corrupt
    cell.cycle(wrong)
    assert cell.supervisor.reason is not None
    cell.run(1.0)
    assert np.all(np.abs(np.diff(cell.speeds(before - 2))) <= 10.0 * CYCLE + 1e-9)
    assert not cell.arm.moving


@pytest.mark.parametrize("period", [0.001, 0.002, 0.004, 0.008])
def test_speed_does_not_depend_on_how_often_messages_come(period):
    cell = GuidedCell(period=period)
    cell.follow(seconds=1.0)
    began = cell.time
    while cell.arm.moving:
        cell.cycle()
    assert cell.time - began == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(cell.sent[-1], FAR, atol=1e-9)
    assert cell.supervisor.reason is None


def test_messages_of_one_time_have_one_answer():
    cell = GuidedCell()
    cell.follow()
    cell.run(1.0)
    first = cell.cycle()
    for _ in range(5):
        np.testing.assert_array_equal(cell.cycle(passed=0.0), first)
    assert cell.cycle()[0] > first[0]


def test_times_in_whole_milliseconds_do_not_make_the_arm_shake():
    """The cycle of an IRC5 is 4.032 ms."""
    period = 0.004032
    cell = GuidedCell()
    cell.follow()
    began, time = cell.time, 0.0
    while cell.arm.moving:
        time, cell.sequence = time + period, cell.sequence + 1
        rounded = began + round(time, 3)
        where = cell.sent[-1].copy()
        message = Feedback(cell.sequence, rounded, where, None, True, Mci.RUNNING, True, stamp=7.0 + time)
        cell.guidance.hear("left", message, began + time)
        cell.sent.append(cell.guidance.answer("left", began + time))
    assert time == pytest.approx(2.0, abs=2 * period)
    jerks = np.diff(np.array(cell.sent[5:])[:, 0] / period, 2)
    assert np.abs(jerks).max() < 2 * CYCLE, "by the millisecond it would be 0.08 rad/s"


def test_a_clock_that_runs_ahead_moves_nothing_faster():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.8)
    start, ours = cell.sent[-1], cell.time
    for number in range(50):
        cell.sequence += 1
        message = Feedback(cell.sequence, ours + 0.012 * number, cell.sent[-1], None, True, Mci.RUNNING, True)
        cell.guidance.hear("left", message, ours + CYCLE * number)
        cell.sent.append(cell.guidance.answer("left", ours + CYCLE * number))
    assert np.all(cell.sent[-1] - start <= 2.0 * (50 * CYCLE + RULES.longest))
    assert (cell.sent[-1] - start)[0] < 0.75 * (50 * CYCLE + RULES.longest), "its path has 0.66 rad/s there at most"


def test_a_program_that_hangs_pauses_the_arm_which_goes_on_when_it_is_back():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.8)
    cell.hangs = True
    cell.run(RULES.pause + HALT + 0.05)
    assert cell.supervisor.reason is None
    assert cell.arm.moving
    assert np.ptp(np.array(cell.sent[-5:]), axis=0).max() == 0, "at rest, on its path"
    paused = cell.sent[-1]
    assert np.all(paused < FAR)
    cell.hangs = False
    cell.run(2.5)
    np.testing.assert_allclose(cell.sent[-1], FAR, atol=1e-9)
    assert np.all(np.abs(np.diff(cell.speeds(0))) <= 10.0 * CYCLE + 1e-9)
    assert cell.supervisor.reason is None


def test_a_slow_tick_pauses_and_a_normal_one_does_not():
    for tick, slower in ((0.1, False), (0.29, False), (0.5, True)):
        cell = GuidedCell()
        cell.follow()
        began, cycles = cell.time, 0
        while cell.arm.moving:
            cell.hangs = cycles % round(tick / CYCLE) != 0
            cell.cycle()
            cycles += 1
        assert cell.supervisor.reason is None
        np.testing.assert_allclose(cell.sent[-1], FAR, atol=1e-9)
        assert (cell.time - began > 2.1) == slower


def test_a_program_that_does_not_come_back_is_stopped():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.8)
    cell.hangs = True
    cell.run(RULES.overrun - 0.05)
    assert cell.supervisor.reason is None
    cell.run(0.1)
    assert "executor" in cell.supervisor.reason
    assert not cell.arm.moving


def test_arms_are_kept_apart_where_they_are_measured_too():
    rules = dataclasses.replace(RULES, clearance_of=lambda: lambda joints: 0.6 - float(joints["left"][0]))
    for measured, what in ((HERE + 0.51, "measured joints"), (None, "setpoints")):
        cell = GuidedCell(dataclasses.replace(rules, lag=1.0), arms=("left", "right"))
        cell.follow()
        cell.run(0.4)
        cell.measured = measured
        cell.run(1.6)
        assert "near" in cell.supervisor.reason
        assert what in cell.supervisor.reason
        assert cell.sent[-1][0] < 0.6, "it came to rest before"


def test_arms_that_a_stop_has_left_too_near_may_go_away_from_there_but_no_nearer():
    def clearance(joints):
        return 0.6 - float(joints["left"][0])

    rules = dataclasses.replace(RULES, clearance_of=lambda: clearance)
    stopped = GuidedCell(rules)
    stopped.follow()
    stopped.run(2.0)
    here = stopped.sent[-1]
    assert "near" in stopped.supervisor.reason
    assert 0 < clearance({"left": here}) < rules.clearance, "the arm rests where no path may lead"

    def accepted(goal):
        path = smooth(here, goal, 2.0)
        return check_trajectory(rules, "left", path, commanded=here, others={}, clearance=clearance)

    accepted(HERE)
    with pytest.raises(Rejected, match="near"):
        accepted(here + 0.002)
    out = GuidedCell(rules, here=here)
    out.follow(HERE)
    out.run(2.5)
    assert out.supervisor.reason is None
    np.testing.assert_allclose(out.sent[-1], HERE, atol=1e-6)
    out.follow(here)
    out.run(2.5)
    assert "near" in out.supervisor.reason, "once it was away, the whole clearance counts again"
    assert out.sent[-1][0] < 0.6
    nearer = GuidedCell(rules, here=here)
    for _ in range(10):  # steps too small for a single path to be nearer
        small = smooth(nearer.sent[-1], nearer.sent[-1] + 0.0003, 1.0)
        nearer.guidance.follow("left", small.times, small.joints, 1)
        nearer.run(1.1)
    assert "near" in nearer.supervisor.reason
    assert nearer.sent[-1][0] < here[0] + 0.001


def test_a_path_that_nobody_checked_cannot_exceed_the_limits():
    cell = GuidedCell()
    at_once = Trajectory(np.array([0.0, 0.1]), np.stack([HERE, FAR]))
    cell.guidance.follow("left", at_once.times, at_once.joints, 1)
    cell.run(1.0)
    assert "more than the arm's speeds" in cell.supervisor.reason
    assert np.all(np.abs(np.diff(cell.speeds(0))) <= 10.0 * CYCLE + 1e-9)


def test_no_path_begins_while_the_arm_moves():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.5)
    path = smooth(cell.sent[-1], HERE)
    assert "still moves" in cell.guidance.follow("left", path.times, path.joints, 2)
    six = np.zeros((2, 6))
    assert "6 joints" in cell.guidance.follow("left", np.array([0.0, 1.0]), six, 2)


def test_an_error_in_a_cycle_brakes():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.8)
    before = len(cell.sent)

    def fail(seconds):
        raise ZeroDivisionError("of course")

    cell.arm.follower.advance = fail
    cell.sequence, cell.time = cell.sequence + 1, cell.time + CYCLE
    message = Feedback(cell.sequence, cell.time, cell.sent[-1], None, True, Mci.RUNNING, True)
    cell.guidance.hear("left", message, cell.time)
    with pytest.raises(ZeroDivisionError) as error:
        cell.guidance.answer("left", cell.time)
    cell.sent.append(cell.guidance.recover("left", error.value))
    cell.run(0.5)
    assert "of course" in cell.supervisor.reason
    speeds = cell.speeds(before - 2)
    assert np.all(np.abs(np.diff(speeds)) <= 10.0 * CYCLE + 1e-9)
    assert speeds[-1] == 0


def test_disabling_brings_the_arm_to_rest_and_holds_it():
    cell = GuidedCell()
    cell.follow()
    cell.run(0.8)
    cell.guidance.disable()
    cell.run(1.0)
    assert np.all(np.abs(np.diff(cell.speeds(0))) <= 10.0 * CYCLE + 1e-9)
    assert np.ptp(np.array(cell.sent[-50:]), axis=0).max() == 0
    cell.measured = cell.sent[-1] - 0.5  # the robot no longer is ours
    cell.run(0.2)
    assert np.ptp(np.array(cell.sent[-50:]), axis=0).max() == 0


def test_an_arm_that_begins_outside_its_bounds_is_held_there():
    here = np.full(7, 0.98)
    cell = GuidedCell(here=here)
    cell.run(0.5)
    np.testing.assert_array_equal(cell.sent[-1], here)
    assert cell.supervisor.reason is None
    cell.follow(HERE)
    cell.run(2.2)
    np.testing.assert_allclose(cell.sent[-1], HERE, atol=1e-9)
    assert cell.supervisor.reason is None


def test_no_setpoint_leaves_its_limits_whatever_happens():
    found = play(range(8))
    assert found["moved"] > 500
    assert 0 < found["stopped"] < 8


def test_no_setpoint_leaves_its_limits_in_100_000_hostile_cycles():
    """In a process whose annotations are not checked, which takes most of the time here."""
    episodes = 100_000 // (2 * EPISODE)  # of two arms
    code = f"from tests.helpers.hostile import play; play(range(1000, {1000 + episodes}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
