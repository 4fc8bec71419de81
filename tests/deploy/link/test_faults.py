"""What goes wrong while the arms move ends in a hold, or does not disturb them."""

import dataclasses
import itertools
import multiprocessing
import os
import signal
import socket
import time

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.protocol import ControllerGone
from bt_jax.deploy.link.safety import Rejected
from tests.helpers.cells import RULES, move, run_for, running

FAULTS = [
    ("motors_off", {}, "not running"),
    ("emergency_stop", {}, "not running"),
    ("silence", {"seconds": 0.6}, "no feedback"),
    ("delay", {"seconds": 0.6}, "no feedback"),
]


@pytest.mark.realtime
@pytest.mark.parametrize(("kind", "details", "word"), FAULTS)
def test_a_fault_in_mid_motion_ends_in_a_hold(kind, details, word):
    with running(realtime=True) as (controller, link):
        move(link, by=1.0, seconds=4.0)
        run_for(link, 0.5)
        controller.fault(kind, **details)
        run_for(link, 2.0, until=lambda: link.stopped() is not None)
        assert word in link.stopped()
        run_for(link, 1.0)
        held, qpos = link.arm("left").commanded, controller.state()[1]
        run_for(link, 0.5)
        np.testing.assert_array_equal(link.arm("left").commanded, held)
        np.testing.assert_allclose(controller.state()[1][7:14], qpos[7:14], atol=1e-4)
        assert not link.arm("left").moving
        with pytest.raises(Rejected):
            move(link)
        with pytest.raises(Rejected):
            link.grip("left", 0.0)


@pytest.mark.realtime
def test_lost_late_and_reordered_messages_do_not_disturb_a_motion():
    with running(realtime=True) as (controller, link):
        goal = link.arm("left").commanded + 0.3
        controller.fault("drop", share=0.05)
        controller.fault("reorder", share=0.05)
        controller.fault("delay", seconds=0.012)
        move(link, by=0.3)
        run_for(link, 2.0)
        assert link.stopped() is None
        np.testing.assert_allclose(link.arm("left").joints, goal, atol=5e-3)
        counters = link.counters()
        assert counters.lost > 0
        assert counters.reordered > 0


def test_strangers_and_malformed_messages_change_nothing():
    with running(realtime=False) as (controller, link):
        sequence = link.drain()[-1, 16]
        foreign = Feedback(int(sequence) + 1, 9.0, np.ones(7), np.ones(7), True, Mci.RUNNING, True).encode()
        before, cycles = link.arm("left"), link.counters().cycles
        for source, data in [("127.0.0.2", foreign), ("127.0.0.2", b"hello"), ("127.0.0.1", b"hello")]:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                stranger.bind((source, 0))
                stranger.settimeout(0.2)
                stranger.sendto(data, ("127.0.0.1", controller.ports["left"]))
                with pytest.raises(TimeoutError):
                    stranger.recv(4096)
        assert link.counters().cycles == cycles
        assert link.arm("left").time == before.time
        np.testing.assert_array_equal(link.arm("left").joints, before.joints)
        goal = before.commanded + 0.1
        move(link, by=0.1, seconds=0.5)
        run_for(link, 1.0)
        assert link.stopped() is None
        np.testing.assert_allclose(link.arm("left").joints, goal, atol=5e-3)


def test_an_arm_that_is_held_stops():
    rules = dataclasses.replace(RULES, lag=0.1)
    with running(realtime=False, rules=rules) as (controller, link):
        controller.push("left_link", np.array([0, 0, -400.0]), 5.0)
        run_for(link, 3.0, until=lambda: link.stopped() is not None)
        assert "holds it" in link.stopped()


def test_setpoints_beyond_the_robots_own_limits_are_refused_by_it():
    wide = dataclasses.replace(RULES, lower=(-9.0,) * 7, upper=(9.0,) * 7)
    with running(realtime=False, rules=wide) as (_, link):
        move(link, by=2.5, seconds=2.0)
        run_for(link, 2.0, until=lambda: link.stopped() is not None)
        assert "not running" in link.stopped()


@pytest.mark.realtime
def test_a_killed_controller_is_noticed():
    with running(realtime=True) as (controller, link):
        move(link)
        run_for(link, 0.2)
        controller.kill()
        run_for(link, 2.0, until=lambda: link.stopped() is not None)
        assert "no feedback" in link.stopped()
        with pytest.raises(Rejected, match="stopped"):
            move(link)


def test_a_killed_controller_is_noticed_in_lockstep():
    with running(realtime=False) as (controller, link):
        controller.kill()
        with pytest.raises(ControllerGone):
            run_for(link, 0.2)
        assert "ended" in link.stopped()


@pytest.mark.realtime
def test_a_program_that_hangs_is_stopped():
    rules = dataclasses.replace(RULES, overrun=0.4)
    with running(realtime=True, rules=rules) as (_, link):
        move(link, seconds=3.0)
        time.sleep(0.8)
        assert "executor" in link.stopped()
        assert not link.arm("left").moving


@pytest.mark.realtime
def test_ctrl_c_does_not_reach_the_processes_below():
    with running(realtime=True) as (controller, link):
        for pid in (controller.pid, link._process.pid):
            os.kill(pid, signal.SIGINT)
        move(link)
        run_for(link, 1.2)
        assert controller.alive
        assert link.stopped() is None
        assert not link.arm("left").moving


@pytest.mark.realtime
def test_the_cycle_is_kept_beside_busy_threads():
    """A Python thread that never rests starves other threads of its process, and must not touch the link."""
    with running(realtime=True) as (_, link):
        move(link, by=0.5, seconds=1.5)
        link.drain()
        end = time.monotonic() + 2.0
        while time.monotonic() < end:
            sum(range(10**5))
            link._blocks.alive.value = time.monotonic()
        records = link.drain()
        assert link.stopped() is None
        assert len(records) > 0.9 * 2 * 2.0 / CYCLE
        assert link.counters().late < 0.05 * link.counters().cycles


def fail_below():
    """Clearance that cannot be told any more once an arm moves, in the link process only."""
    asked = itertools.count()

    def clearance(joints):
        if multiprocessing.parent_process() is not None and next(asked) >= 5:
            raise ZeroDivisionError("no distance")
        return 1.0

    return clearance


def test_an_error_in_a_cycle_stops_the_robot_while_setpoints_go_on():
    with running(realtime=False, rules=dataclasses.replace(RULES, clearance_of=fail_below)) as (_, link):
        move(link, by=0.5)
        run_for(link, 0.5)
        assert "no distance" in link.stopped()
        assert link._process.is_alive()
        held, before = link.arm("left").commanded, link.counters().cycles
        run_for(link, 0.2)
        assert link.counters().cycles > before + 20
        np.testing.assert_array_equal(link.arm("left").commanded, held)


@pytest.mark.parametrize(
    "request_", [("follow", "left", np.zeros(2), np.zeros((2, 7)), 1), ("halt", "third"), ("run",), ("answer", 1)]
)
def test_a_request_that_raises_is_answered_and_stops_the_robot_while_setpoints_go_on(request_):
    with running(realtime=False) as (_, link):
        problem = link._ask(*request_)
        assert "failed to do as asked" in problem
        assert link.stopped() == problem
        before = link.counters().cycles
        run_for(link, 0.2)
        assert link._process.is_alive()
        assert link.counters().cycles > before + 20
