"""However the link ends, the robot's program ends with it."""

import os
import signal
import time

import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.rws import EGM_REQUEST, Motion, Rws, symbol
from bt_jax.deploy.link.rws_errors import ControllerBusy
from bt_jax.deploy.link.safety import Rejected
from bt_jax.deploy.link.settings import LinkTiming, link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import ARMS, RULES, cell, move, run_for, running


@pytest.mark.parametrize("realtime", [pytest.param(True, marks=pytest.mark.realtime), False])
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


@pytest.mark.realtime
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

    monkeypatch.setattr(Irc5Link, "_ramp_out", press)
    with running(realtime=False) as (controller, link):
        with pytest.raises(KeyboardInterrupt):
            link.close()
        rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
        assert rws.state().rapid == "stopped"
        assert not link._process.is_alive()
        rws.close()


def test_stop_and_close_reach_the_controller_without_the_link_process():
    for end in (lambda link: link.stop("somebody shouted"), Irc5Link.close):
        with running(realtime=False) as (controller, link):
            link._process.kill()
            link._process.join()
            end(link)
            rws = Rws("127.0.0.1", controller.rws_port, "Default User", "robotics")
            assert rws.state().rapid == "stopped"
            rws.close()


def test_a_latched_stop_ends_with_its_process_and_the_robots_program():
    ports = free_ports(YUMI.arm_names)
    with Controller(cell(), ports=ports, realtime=False) as controller:
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)
        with Irc5Link(config, RULES, controller) as link:
            link.start()
            link.stop("somebody shouted")
            run_for(link, 0.5)
            assert link.stopped() == "somebody shouted"
            assert link.state().rapid == "stopped"
            link.stop("something else")
            assert link.stopped() == "somebody shouted", "the first reason stays, for good"
            with pytest.raises(Rejected, match="shouted"):
                move(link)
        with Irc5Link(config, RULES, controller) as link:
            assert link.stopped() is None
            link.start()
            move(link)
            run_for(link, 1.5)
            assert link.stopped() is None
            controller.fault("motors_off")
            run_for(link, 0.5, until=lambda: link.stopped() is not None)
        with Irc5Link(config, RULES, controller) as link, pytest.raises(UserError, match="motors on"):
            link.start()


def test_a_stop_that_the_controller_does_not_confirm_is_said_until_it_does(monkeypatch):
    stop, refuse = Rws.stop, True

    def stop_or_not(rws):
        if refuse:
            raise ControllerBusy("the controller is busy")
        stop(rws)

    monkeypatch.setattr(Rws, "stop", stop_or_not)
    with running(realtime=False) as (_, link):
        assert "press the stop" in link.stop("somebody shouted")
        assert "press the stop" in link.unconfirmed()
        assert link.state().rapid == "running"
        refuse = False
        assert link.stop("somebody shouted") == ""
        assert link.unconfirmed() is None
        assert link.state().rapid == "stopped"


def test_what_the_controller_says_is_told_where_the_stop_is_not_confirmed_too(monkeypatch):
    with running(realtime=False) as (controller, link):
        controller.fault("emergency_stop")
        run_for(link, 0.5, until=lambda: link.stopped() is not None)
        with monkeypatch.context() as patch:
            patch.setattr(Rws, "execution", lambda rws: "running")
            said = link.stop("somebody shouted")
        assert said.endswith("press the stop; the controller says '10013 Emergency stop'")


def test_a_stop_tells_what_the_controller_says_of_it():
    with running(realtime=False) as (controller, link):
        controller.fault("emergency_stop")
        run_for(link, 0.5, until=lambda: link.stopped() is not None)
        assert link.stop("somebody shouted") == "the controller says '10013 Emergency stop'"


@pytest.mark.realtime
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
        listen = [("set_number", symbol(arm, EGM_REQUEST), float(Motion.LISTEN)) for arm in ARMS]
        assert told == ([*listen, ("stop",)] if well else []), "a stop that is confirmed needs no other"
        assert rws.state().rapid == "stopped"
        rws.close()
