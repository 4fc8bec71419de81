"""What is watched while the robot runs; each fault is made once."""

import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.supervision import Supervisor
from tests.helpers import guided

RULES = dataclasses.replace(guided.RULES, acceleration=(20.0,), margin=0.1)
ARMS = ("left", "right")


def feedback(sequence, joints=0.0, **changes):
    state = Feedback(sequence, sequence * CYCLE, np.full(7, joints), np.full(7, joints), True, Mci.RUNNING, True)
    return dataclasses.replace(state, **changes)


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


def test_a_clock_that_stands_still_stops():
    supervisor = Supervisor(RULES, ARMS)
    for number in range(1, 40):
        supervisor.accept(
            "left", feedback(number, time=5.0 if number < 30 else 6.0), CYCLE * number, moving_allowed=True
        )
        assert (supervisor.reason is not None) == (CYCLE * (number - 1) > RULES.stale)
        if supervisor.reason is not None:
            break
    assert "clock" in supervisor.reason


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


def test_an_arm_that_does_not_follow_stops_and_brakes():
    supervisor = Supervisor(RULES, ARMS)
    supervisor.keep_up("left", RULES.lag)
    assert supervisor.reason is None
    supervisor.keep_up("left", 1.1 * RULES.lag)
    assert "holds it" in supervisor.reason
    assert supervisor.braking


def test_arms_that_come_near_each_other_stop_and_brake():
    rules = dataclasses.replace(
        RULES, clearance_of=lambda: lambda joints: float(abs(joints["left"][0] - joints["right"][0]))
    )
    supervisor = Supervisor(rules, ARMS)
    supervisor.keep_clear({"left": np.full(7, 0.3), "right": np.zeros(7)}, "setpoints")
    assert supervisor.reason is None
    supervisor.keep_clear({"left": np.zeros(7), "right": np.zeros(7)}, "measured joints")
    assert "near" in supervisor.reason
    assert "measured joints" in supervisor.reason
    assert supervisor.braking


def test_a_setpoint_that_is_not_permitted_stops_and_brakes():
    supervisor = Supervisor(RULES, ARMS)
    assert supervisor.permits("left", np.zeros(7), before=np.zeros(7))
    assert not supervisor.permits("left", np.full(7, 0.95), before=np.zeros(7))
    assert "joint 1" in supervisor.reason
    assert supervisor.braking


def test_a_stop_is_for_good_and_any_later_one_may_demand_to_brake():
    supervisor = Supervisor(RULES, ARMS)
    supervisor.stop("first")
    assert not supervisor.braking
    supervisor.stop("second", brake=True)
    supervisor.stop("third")
    assert supervisor.reason == "first"
    assert supervisor.braking
