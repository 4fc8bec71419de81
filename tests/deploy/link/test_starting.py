"""What must be so before the arms follow, and what is said where it is not."""

import contextlib
import dataclasses

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.rapid_program import RapidProgram
from bt_jax.deploy.link.rws import EGM_HERE, EGM_REQUEST, Motion, Rws, symbol
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import ARMS, RULES, cell, move, run_for, running, skipped_where_starved


@pytest.mark.realtime
def test_a_link_that_only_listens_never_answers():
    ports = free_ports(YUMI.arm_names)
    listening = link_config(YUMI, "127.0.0.1", ports, motion=False)
    with contextlib.ExitStack() as stack:
        controller = stack.enter_context(Controller(cell(), ports=ports, realtime=True))
        listening = dataclasses.replace(listening, rws_port=controller.rws_port)
        link = Irc5Link(listening, RULES, controller)
        stack.enter_context(skipped_where_starved(controller, link))
        stack.enter_context(link)
        run_for(link, 0.3)
        assert link.arm("left").joints == pytest.approx(np.full(7, 0.1), abs=1e-3)
        move(link)
        link.grip("left", 0.0)
        with pytest.raises(UserError, match="listens"):
            link.start()
        run_for(link, 0.3)
        assert link.arm("left").joints == pytest.approx(np.full(7, 0.1), abs=1e-3)
        assert not link.arm("left").running


@pytest.mark.parametrize("realtime", [pytest.param(True, marks=pytest.mark.realtime), False])
def test_nothing_is_answered_before_the_start_and_then_the_first_joints_are_held(realtime):
    with running(realtime=realtime, start=False) as (controller, link):
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        rws.start()
        for arm in ARMS:  # somebody else asks the robot to follow: nobody answers, and it gives up
            rws.set_number(symbol(arm, EGM_REQUEST), float(Motion.GUIDED))
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


@pytest.mark.realtime
def test_taken_ports_and_wrong_users_are_said_in_a_sentence():
    ports = free_ports(YUMI.arm_names)
    with Controller(cell(), ports=ports, realtime=True) as controller, skipped_where_starved(controller):
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)
        wrong = dataclasses.replace(config, password="guess")
        with Irc5Link(wrong, RULES, controller) as link, pytest.raises(UserError, match="refuses the user"):
            link.start()
        nowhere = dataclasses.replace(config, rws_port=1)
        with Irc5Link(nowhere, RULES) as link, pytest.raises(UserError, match="cannot be reached"):
            link.state()
        with Irc5Link(config, RULES, controller):
            with pytest.raises(UserError, match="cannot be used"), Irc5Link(config, RULES, controller):
                pass
            controller.fault("motors_off")
            rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
            assert rws.state().control == "motoroff"
            with pytest.raises(UserError, match="automatic mode"):
                rws.start()
            with pytest.raises(UserError, match="has no nothing of module BtJax in task T_ROB_L"):
                rws.number("RAPID/T_ROB_L/BtJax/nothing")


def test_an_unknown_controller_is_said_in_a_sentence():
    with pytest.raises(UserError, match="--robot"):
        Irc5Link(link_config(YUMI, "nowhere.invalid", free_ports(YUMI.arm_names)), RULES)


@pytest.mark.realtime
def test_a_motor_that_is_off_cannot_be_started():
    with running(realtime=True, start=False) as (controller, link):
        controller.fault("motors_off")
        with pytest.raises(UserError, match="motors on"):
            link.start()


def test_a_start_away_from_the_ready_target_counts_once_also_if_it_fails():
    with running(realtime=False, start=False) as (controller, link):
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        program = RapidProgram(link.config, realtime=False)
        controller.fault("motors_off")
        with pytest.raises(UserError, match="automatic mode"):
            program.start(here=True)
        assert [rws.number(symbol(arm, EGM_HERE)) for arm in ARMS] == [0.0, 0.0]
        program.close()
        rws.close()
    with running(realtime=False, start=False) as (controller, link):
        link.start(here=True)
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        assert [rws.number(symbol(arm, EGM_HERE)) for arm in ARMS] == [0.0, 0.0]
        rws.close()


def test_a_program_that_has_stopped_is_not_taken_for_one_whose_egm_is_set_up_wrongly():
    with running(realtime=False, start=False) as (_, link):
        program = RapidProgram(link.config, realtime=False)
        program.expect_stop()
        assert "ready target" in program.why_not_followed("left: not guided")
        program.start()
        assert "EGM is set up" in program.why_not_followed("left: not guided")
        program.close()
