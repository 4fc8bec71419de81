import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.safety import Rejected, Rules, Supervisor, check_setpoint, check_trajectory
from bt_jax.deploy.planning.trajectory import Trajectory


def reach(arm, joints):
    """A one-joint arm of a metre in the plane."""
    tip = np.array([np.cos(joints[0]), np.sin(joints[0]), 0.5])
    return {"tcp": tip, "elbow": tip / 2}


RULES = Rules(
    lower=(-1.0,) * 7,
    upper=(1.0,) * 7,
    speed=(2.0,) * 7,
    margin=0.1,
    lowest=(-0.1, -0.7, 0.0),
    highest=(1.1, 0.7, 1.0),
    points=reach,
)
ARMS = ("left", "right")


def feedback(sequence, joints=0.0, **changes):
    state = Feedback(sequence, sequence * CYCLE, np.full(7, joints), np.full(7, joints), True, Mci.RUNNING, True)
    return dataclasses.replace(state, **changes)


def path(*points, seconds=1.0):
    return Trajectory(np.linspace(0, seconds, len(points)), np.array([np.full(7, p, float) for p in points]))


def check(trajectory, rules=RULES, commanded=0.0, clearance=None):
    return check_trajectory(
        rules, "left", trajectory, commanded=np.full(7, commanded), others={"right": np.zeros(7)}, clearance=clearance
    )


@pytest.mark.parametrize(
    ("joint", "value", "word"),
    [(3, np.nan, "number"), (2, np.inf, "number"), (4, 0.95, "joint 5"), (6, -0.91, "joint 7"), (0, 0.8, "tcp")],
)
def test_a_setpoint_out_of_bounds_is_rejected(joint, value, word):
    joints = np.zeros(7)
    check_setpoint(RULES, "left", joints)
    joints[joint] = value
    with pytest.raises(Rejected, match=word):
        check_setpoint(RULES, "left", joints)


@given(st.lists(st.floats(-2, 2), min_size=7, max_size=7))
def test_what_is_admitted_is_within_the_limits_and_one_step_away(target):
    supervisor = Supervisor(RULES, ARMS)
    commanded = np.zeros(7)
    sent = supervisor.admit("left", np.array(target), commanded=commanded, measured=commanded)
    assert np.all(np.abs(sent) <= 2.0 * CYCLE * 1.05 + 1e-12)
    if supervisor.reason is None:
        check_setpoint(RULES, "left", np.array(target))
        assert supervisor.clipped == (not np.array_equal(sent, target))
        np.testing.assert_allclose(np.sign(sent), np.sign(target))
    else:
        np.testing.assert_array_equal(sent, commanded)


def test_a_path_is_rejected_as_a_whole():
    check(path(0, 0.3, 0.6))
    for bad, word in [
        (path(0, 0.5, 0.95, 0.5, seconds=4), "joint"),
        (path(0.1, 0.2), "begins"),
        (path(0, 0.6, seconds=0.2), "rad/s"),
        (path(0, 0.78, seconds=2), "workspace"),
        (path(0, np.nan), "number"),
    ]:
        with pytest.raises(Rejected, match=word):
            check(bad)


def test_a_path_that_comes_too_near_is_rejected_wherever_that_happens():
    def clearance(joints):
        return abs(joints["left"][0] - 0.3)

    check(path(0, 0.25), clearance=clearance)
    with pytest.raises(Rejected, match="mm"):
        check(path(0, 0.6), clearance=clearance)


def test_a_path_is_slowed_down_to_the_override():
    rules = dataclasses.replace(RULES, override=0.2)
    allowed = check(path(0, 0.5), rules)
    assert np.abs(allowed.speeds()).max() == pytest.approx(0.2)
    assert check(path(0, 0.1), rules).duration == 1.0


def test_lost_messages_are_tolerated_up_to_a_gap():
    supervisor = Supervisor(RULES, ARMS)
    for sequence in (1, 2, 5, 6, 17):
        assert supervisor.accept("left", feedback(sequence), 0.0, moving_allowed=True)
    assert supervisor.reason is None
    assert supervisor.lost == 12
    supervisor.accept("left", feedback(17 + RULES.gap + 2), 0.0, moving_allowed=True)
    assert "lost" in supervisor.reason


def test_late_and_repeated_messages_are_ignored():
    supervisor = Supervisor(RULES, ARMS)
    for sequence, taken in [(10, True), (11, True), (10, False), (11, False), (12, True)]:
        assert supervisor.accept("left", feedback(sequence), 0.0, moving_allowed=True) == taken
    assert supervisor.reordered == 2
    assert supervisor.reason is None


def test_a_new_session_may_count_again_but_not_while_the_robot_follows():
    supervisor = Supervisor(RULES, ARMS)
    for sequence in (1000, 1001, 1, 2):
        assert supervisor.accept("left", feedback(sequence), 0.0, moving_allowed=False)
    assert (supervisor.lost, supervisor.reordered) == (0, 0)
    supervisor.accept("left", feedback(1003), 0.0, moving_allowed=False)
    assert not supervisor.accept("left", feedback(1), 0.0, moving_allowed=True)
    assert not supervisor.accept("left", feedback(1002), 0.0, moving_allowed=False)


def test_numbers_may_wrap():
    supervisor = Supervisor(RULES, ARMS)
    for sequence in (2**32 - 2, 2**32 - 1, 0, 1):
        assert supervisor.accept("left", feedback(sequence), 0.0, moving_allowed=True)
    assert supervisor.lost == 0


@pytest.mark.parametrize(
    "change", [{"motors_on": False}, {"mci": Mci.STOPPED}, {"mci": Mci.ERROR}, {"rapid_running": False}]
)
def test_any_state_but_running_stops(change):
    supervisor = Supervisor(RULES, ARMS)
    supervisor.accept("left", feedback(1, **change), 0.0, moving_allowed=False)
    assert supervisor.reason is None
    supervisor.accept("left", feedback(2, **change), 0.0, moving_allowed=True)
    assert "not running" in supervisor.reason


def test_measurements_that_are_no_numbers_stop():
    supervisor = Supervisor(RULES, ARMS)
    supervisor.accept("left", feedback(1, np.nan), 0.0, moving_allowed=True)
    assert "not numbers" in supervisor.reason


def test_silence_of_the_controller_stops():
    supervisor = Supervisor(RULES, ARMS)
    supervisor.accept("left", feedback(1), 1.0, moving_allowed=True)
    supervisor.accept("right", feedback(1), 1.0, moving_allowed=True)
    supervisor.watch(1.0 + 0.9 * RULES.stale, alive=1.0, moving=True)
    assert supervisor.reason is None
    supervisor.accept("right", feedback(2), 1.1, moving_allowed=True)
    supervisor.watch(1.0 + 1.1 * RULES.stale, alive=1.0, moving=True)
    assert supervisor.reason.startswith("left: no feedback")


@pytest.mark.parametrize(("moving", "limit"), [(True, RULES.overrun), (False, RULES.idle)])
def test_silence_of_the_executor_stops(moving, limit):
    supervisor = Supervisor(RULES, ARMS)
    supervisor.watch(100.0, alive=100.0 - 0.9 * limit, moving=moving)
    assert supervisor.reason is None
    supervisor.watch(100.0, alive=100.0 - 1.1 * limit, moving=moving)
    assert "executor" in supervisor.reason


def test_an_arm_that_does_not_follow_stops():
    supervisor = Supervisor(RULES, ARMS)
    measured = np.full(7, 0.1)
    sent = supervisor.admit("left", np.full(7, 0.5), commanded=np.full(7, 0.5), measured=measured)
    assert "holds it" in supervisor.reason
    np.testing.assert_array_equal(sent, measured)


@pytest.mark.parametrize("known", [0, 6])
def test_an_arm_that_is_no_longer_measured_is_held_all_the_same(known):
    supervisor = Supervisor(RULES, ARMS)
    commanded = np.full(7, 0.2)
    measured = np.where(np.arange(7) < known, 0.19, np.nan)
    for _ in range(2):
        sent = supervisor.admit("left", np.full(7, 0.21), commanded=commanded, measured=measured)
        np.testing.assert_array_equal(sent, np.where(np.arange(7) < known, 0.19, 0.2))
    assert supervisor.reason is not None


def test_arms_that_come_near_each_other_stop():
    rules = dataclasses.replace(
        RULES, clearance_of=lambda: lambda joints: float(abs(joints["left"][0] - joints["right"][0]))
    )
    supervisor = Supervisor(rules, ARMS)
    apart, near = {"left": np.full(7, 0.3), "right": np.zeros(7)}, {"left": np.zeros(7), "right": np.zeros(7)}
    supervisor.keep_clear(apart, moving=True)
    supervisor.keep_clear(near, moving=False)
    assert supervisor.reason is None
    supervisor.keep_clear(near, moving=True)
    assert "near" in supervisor.reason


def test_a_stop_is_for_good_and_holds_where_the_arm_was():
    supervisor = Supervisor(RULES, ARMS)
    supervisor.stop("first")
    supervisor.stop("second")
    assert supervisor.reason == "first"
    where = np.full(7, 0.2)
    for drift in (0.0, 0.01, 0.02):  # an arm that sags must not be followed down
        sent = supervisor.admit("left", np.full(7, 0.5), commanded=np.full(7, 0.21), measured=where + drift)
        np.testing.assert_array_equal(sent, where)


def test_holding_is_allowed_outside_the_limits():
    supervisor = Supervisor(RULES, ARMS)
    outside = np.full(7, 0.95)
    np.testing.assert_array_equal(supervisor.admit("left", outside, commanded=outside, measured=outside), outside)
    assert supervisor.reason is None


def test_a_path_of_another_arms_joints_is_rejected():
    path = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 6)))
    with pytest.raises(Rejected, match="6 joints, the arm has 7"):
        check_trajectory(RULES, "left", path, commanded=np.zeros(7), others={"right": np.zeros(7)}, clearance=None)
