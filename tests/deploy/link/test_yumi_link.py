"""The link with everything real but the robot: processes, sockets, EGM, RWS, physics."""

import contextlib
import dataclasses
import os
import signal
import socket
import time

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.protocol import ControllerGone, RobotLink
from bt_jax.deploy.link.rws import EGM_MOTION, Motion, Rws, symbol
from bt_jax.deploy.link.safety import Rejected
from bt_jax.deploy.link.settings import LinkConfig, LinkTiming
from bt_jax.deploy.link.yumi_link import YumiLink
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.twin.controller import Controller
from tests.helpers.cells import ARMS, RULES, cell, free_ports, run_for, running


def move(link, arm="left", by=0.3, seconds=1.0):
    start = link.arm(arm).commanded
    return link.follow(arm, Trajectory(np.array([0.0, seconds]), np.stack([start, start + by])))


def near(left, right):
    return float(0.5 - abs(left[0] - right[0]))


def make_near():
    return near


@pytest.fixture(scope="module")
def lockstep():
    with running(realtime=False) as pair:
        yield pair


def test_follows_a_path_with_both_arms(lockstep):
    _, link = lockstep
    assert isinstance(link, RobotLink)
    goals = {arm: link.arm(arm).commanded + 0.2 for arm in ARMS}
    numbers = [move(link, arm, 0.2) for arm in ARMS]
    assert numbers[1] > numbers[0]
    run_for(link, 0.1)
    assert all(link.arm(arm).moving for arm in ARMS)
    run_for(link, 1.5)
    for arm in ARMS:
        state = link.arm(arm)
        assert not state.moving
        np.testing.assert_allclose(state.commanded, goals[arm], atol=1e-9)
        np.testing.assert_allclose(state.joints, goals[arm], atol=2e-3)
    assert link.counters().lost == link.counters().reordered == 0


def test_time_is_that_of_the_simulation(lockstep):
    controller, link = lockstep
    start, cycles = link.now(), controller.stats().cycles
    run_for(link, 2.0)
    assert link.now() == pytest.approx(start + 2.0)
    assert controller.stats().cycles - cycles == 500
    assert link.arm("left").time == pytest.approx(link.now(), abs=1e-3)


def test_halting_is_smooth_and_on_the_path(lockstep):
    _, link = lockstep
    start = link.arm("left").commanded
    move(link, by=-0.4)
    run_for(link, 0.4)
    link.drain()
    link.halt("left")
    run_for(link, 0.6, until=lambda: False)
    state = link.arm("left")
    assert not state.moving
    done = (state.commanded - start) / -0.4
    np.testing.assert_allclose(done, done[0], atol=1e-9)
    assert 0.4 < done[0] < 0.7
    records = link.drain()
    setpoints = records[records[:, 0] == 0][:, 2]
    assert np.all(np.diff(np.abs(np.diff(setpoints))) < 1e-9), "speed only falls"
    assert link.stopped() is None


def test_the_gripper_moves_and_is_blocked_by_nothing(lockstep):
    _, link = lockstep
    link.grip("right", 0.02)
    run_for(link, 1.5)
    assert link.arm("right").opening == pytest.approx(0.02, abs=1e-3)
    assert link.arm("right").grip_target == 0.02
    link.grip("right", 0.05, force=20.0)
    run_for(link, 1.5)
    assert link.arm("right").opening == pytest.approx(0.05, abs=1e-3)


def test_a_path_that_breaks_a_rule_moves_nothing(lockstep):
    _, link = lockstep
    before, rejected = link.arm("left").commanded, link.counters().rejected
    for by, seconds in [(2.5, 3.0), (0.5, 0.05), (np.nan, 1.0)]:
        with pytest.raises(Rejected):
            move(link, by=by, seconds=seconds)
    with pytest.raises(Rejected, match="begins"):
        link.follow("left", Trajectory(np.array([0.0, 1.0]), np.stack([before + 0.1, before])))
    run_for(link, 0.2)
    np.testing.assert_array_equal(link.arm("left").commanded, before)
    assert link.counters().rejected == rejected + 4
    assert link.stopped() is None


def test_the_log_has_every_cycle(lockstep):
    _, link = lockstep
    link.drain()
    run_for(link, 1.0)
    records = link.drain()
    for index in range(len(ARMS)):
        rows = records[records[:, 0] == index]
        np.testing.assert_allclose(np.diff(rows[:, 1]), CYCLE, atol=1.1e-3)
        np.testing.assert_array_equal(np.diff(rows[:, 16]), 1)


def test_a_hand_moves_boxes_only(lockstep):
    controller, link = lockstep
    controller.put("box", RigidTransform.from_translation([0.4, 0.1, 0.02]))
    run_for(link, 0.2)
    np.testing.assert_allclose(controller.state()[1][:3], [0.4, 0.1, 0.02], atol=1e-3)
    controller.push("box", np.array([3.0, 0, 0]), 0.2)
    run_for(link, 0.5)
    assert controller.state()[1][0] > 0.41
    with pytest.raises(UserError, match="refuses put"):
        controller.put("nothing", RigidTransform.identity())


def test_clearance_is_watched_for_paths_and_while_moving():
    rules = dataclasses.replace(RULES, clearance=0.1, clearance_of=make_near)
    with running(realtime=False, rules=rules) as (_, link):
        with pytest.raises(Rejected, match="mm"):
            move(link, by=0.5)
        assert link.stopped() is None
        move(link, "left", by=0.3)
        move(link, "right", by=-0.3)  # each alone is clear of where the other is sent now; together they are not
        run_for(link, 1.0, until=lambda: link.stopped() is not None)
        assert "near" in link.stopped()
        held = link.arm("left").commanded
        run_for(link, 0.3)
        np.testing.assert_array_equal(link.arm("left").commanded, held)


FAULTS = [
    ("motors_off", {}, "not running"),
    ("emergency_stop", {}, "not running"),
    ("silence", {"seconds": 0.6}, "no feedback"),
    ("delay", {"seconds": 0.6}, "no feedback"),
]


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


@pytest.mark.parametrize("realtime", [True, False])
def test_where_the_link_process_is_killed_the_robots_program_is_stopped(realtime):
    with running(realtime=realtime) as (_, link):
        move(link, seconds=3.0)
        run_for(link, 0.2)
        assert link.state().rapid == "running"
        link._process.kill()
        link._process.join()
        run_for(link, 3.0, until=lambda: link.state().rapid == "stopped")
        assert link.state().rapid == "stopped"
        assert "link process has ended" in link.stopped()
        with pytest.raises(Rejected, match="stopped"):
            link.grip("left", 0.0)


@pytest.mark.slow
def test_where_the_link_process_hangs_the_robots_program_is_stopped_at_once():
    with running(realtime=True) as (_, link):
        move(link, seconds=3.0)
        run_for(link, 0.2)
        os.kill(link._process.pid, signal.SIGSTOP)
        began = time.monotonic()
        with pytest.raises(UserError, match="does not answer"):
            link.halt("left")
        assert link.state().rapid == "stopped"
        link.stop("somebody shouted")
        link.close()
        assert time.monotonic() - began < LinkTiming().startup / 2, "it is not waited for as for one that starts"
        assert link.stopped() == "the link process does not answer"


def test_ctrl_c_while_guided_motion_ends_stops_the_robots_program(monkeypatch):
    def press(link):
        raise KeyboardInterrupt

    monkeypatch.setattr(YumiLink, "_ramp_out", press)
    with running(realtime=False) as (controller, link):
        with pytest.raises(KeyboardInterrupt):
            link.close()
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        assert rws.state().rapid == "stopped"
        assert not link._process.is_alive()
        rws.close()


def test_stop_and_close_reach_the_controller_without_the_link_process():
    for end in (lambda link: link.stop("somebody shouted"), YumiLink.close):
        with running(realtime=False) as (controller, link):
            link._process.kill()
            link._process.join()
            end(link)
            rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
            assert rws.state().rapid == "stopped"
            rws.close()


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


def test_an_unknown_controller_is_said_in_a_sentence():
    with pytest.raises(UserError, match="--robot"):
        YumiLink(LinkConfig("nowhere.invalid", free_ports()), RULES)


def test_a_program_that_hangs_is_stopped():
    rules = dataclasses.replace(RULES, overrun=0.4)
    with running(realtime=True, rules=rules) as (_, link):
        move(link, seconds=3.0)
        time.sleep(0.8)
        assert "executor" in link.stopped()
        assert not link.arm("left").moving


def test_an_arm_that_is_held_stops():
    rules = dataclasses.replace(RULES, lag=0.1)
    with running(realtime=False, rules=rules) as (controller, link):
        controller.push("left_link", np.array([0, 0, -400.0]), 5.0)
        run_for(link, 3.0, until=lambda: link.stopped() is not None)
        assert "holds it" in link.stopped()


def test_interrupting_brings_the_arms_to_rest_on_the_path():
    with running(realtime=False) as (_, link):
        start = link.arm("left").commanded
        move(link, by=0.5)
        run_for(link, 0.3)
        link.interrupt()
        run_for(link, 0.5)
        state = link.arm("left")
        assert not state.moving
        assert np.all((state.commanded > start + 0.1) & (state.commanded < start + 0.3))
        with pytest.raises(Rejected, match="interrupted"):
            move(link)


def test_ctrl_c_does_not_reach_the_processes_below():
    with running(realtime=True) as (controller, link):
        for pid in (controller.pid, link._process.pid):
            os.kill(pid, signal.SIGINT)
        move(link)
        run_for(link, 1.2)
        assert controller.alive
        assert link.stopped() is None
        assert not link.arm("left").moving


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


def test_a_link_that_only_listens_never_answers():
    ports = free_ports()
    listening = LinkConfig("127.0.0.1", ports, motion=False)
    with contextlib.ExitStack() as stack:
        controller = stack.enter_context(Controller(cell(), ports=ports, realtime=True))
        listening = dataclasses.replace(listening, rws_port=controller.rws_port)
        link = stack.enter_context(YumiLink(listening, RULES, controller))
        run_for(link, 0.3)
        assert link.arm("left").joints == pytest.approx(np.full(7, 0.1), abs=1e-3)
        move(link)
        link.grip("left", 0.0)
        with pytest.raises(UserError, match="listens"):
            link.start()
        run_for(link, 0.3)
        assert link.arm("left").joints == pytest.approx(np.full(7, 0.1), abs=1e-3)
        assert not link.arm("left").running


@pytest.mark.parametrize("realtime", [True, False])
def test_nothing_is_answered_before_the_start_and_then_the_first_joints_are_held(realtime):
    with running(realtime=realtime, start=False) as (controller, link):
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        rws.start()
        for arm in ARMS:  # somebody else asks the robot to follow: nobody answers, and it gives up
            rws.set_number(symbol(arm, EGM_MOTION), float(Motion.ASKED))
        run_for(link, 1.0)
        assert controller.stats().unanswered > 50
        assert rws.state().rapid == "stopped"
        link.drain()
        link.start()
        first = link.arm("left").commanded
        records = link.drain()
        held = records[(records[:, 0] == 0)][-1, 2:9]
        np.testing.assert_array_equal(held, first)
        controller.push("left_link", np.array([0, 0, -20.0]), 0.4)  # the arm gives way, its setpoint does not
        link._ask("disable")
        run_for(link, 0.3)
        assert np.max(np.abs(link.arm("left").joints - first)) > 1e-3
        np.testing.assert_array_equal(link.arm("left").commanded, first)
        rws.close()


def test_an_arm_that_was_moved_since_the_start_is_not_guided():
    with running(realtime=False, start=False) as (controller, link):
        run_for(link, 0.1)
        link._ask("answer")
        run_for(link, 0.1)
        controller.push("left_link", np.array([0, 0, -400.0]), 60.0)
        run_for(link, 0.5)
        with pytest.raises(UserError, match="not where it was"):
            link.start()
        assert not link.arm("right").moving
    assert link.stopped() is None


def test_taken_ports_and_wrong_users_are_said_in_a_sentence():
    ports = free_ports()
    with Controller(cell(), ports=ports, realtime=True) as controller:
        config = LinkConfig("127.0.0.1", ports, controller.rws_port, motion=True)
        wrong = dataclasses.replace(config, password="guess")
        with pytest.raises(UserError, match="refuses the user"), YumiLink(wrong, RULES, controller):
            pass
        nowhere = dataclasses.replace(config, rws_port=1)
        with pytest.raises(UserError, match="cannot be reached"), YumiLink(nowhere, RULES):
            pass
        with YumiLink(config, RULES, controller):
            with pytest.raises(UserError, match="cannot be used"), YumiLink(config, RULES, controller):
                pass
            controller.fault("motors_off")
            rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
            assert rws.state().control == "motoroff"
            with pytest.raises(UserError, match="automatic mode"):
                rws.start()
            with pytest.raises(UserError, match="404"):
                rws.number("RAPID/T_ROB_L/BtJax/nothing")


def test_a_motor_that_is_off_cannot_be_started():
    with running(realtime=True, start=False) as (controller, link):
        controller.fault("motors_off")
        with pytest.raises(UserError, match="motors on"):
            link.start()


def test_a_latched_stop_ends_with_its_process_and_the_robots_program():
    ports = free_ports()
    with Controller(cell(), ports=ports, realtime=False) as controller:
        config = LinkConfig("127.0.0.1", ports, controller.rws_port, motion=True)
        with YumiLink(config, RULES, controller) as link:
            link.start()
            link.stop("somebody shouted")
            run_for(link, 0.5)
            assert link.stopped() == "somebody shouted"
            assert link.state().rapid == "stopped"
            link.stop("something else")
            assert link.stopped() == "somebody shouted", "the first reason stays, for good"
            with pytest.raises(Rejected, match="shouted"):
                move(link)
        with YumiLink(config, RULES, controller) as link:
            assert link.stopped() is None
            link.start()
            move(link)
            run_for(link, 1.5)
            assert link.stopped() is None
            controller.fault("motors_off")
            run_for(link, 0.5, until=lambda: link.stopped() is not None)
        with YumiLink(config, RULES, controller) as link, pytest.raises(UserError, match="motors on"):
            link.start()


@pytest.mark.parametrize("well", [True, False])
def test_guided_motion_is_ended_before_the_program_where_all_is_well(well, monkeypatch):
    told = []
    for name, call in [("set_number", Rws.set_number), ("stop", Rws.stop)]:

        def seen(rws, *arguments, name=name, call=call):
            told.append((name, *arguments))
            call(rws, *arguments)

        monkeypatch.setattr(Rws, name, seen)
    with running(realtime=True) as (controller, link):
        if not well:
            link.stop("somebody shouted")
        told.clear()
        link.close()
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        listen = [("set_number", symbol(arm, EGM_MOTION), float(Motion.LISTEN)) for arm in ARMS]
        assert told == [*(listen if well else []), ("stop",)]
        assert rws.state().rapid == "stopped"
        rws.close()


def test_setpoints_beyond_the_robots_own_limits_are_refused_by_it():
    wide = dataclasses.replace(RULES, lower=(-9.0,) * 7, upper=(9.0,) * 7)
    with running(realtime=False, rules=wide) as (_, link):
        move(link, by=2.5, seconds=2.0)
        run_for(link, 2.0, until=lambda: link.stopped() is not None)
        assert "not running" in link.stopped()
