"""The robot's program is stopped when the controller says so, and not before."""

import math
import time

import pytest

from bt_jax.deploy.link.controller_watch import ControllerWatch
from bt_jax.deploy.link.program_stop import ProgramStop
from bt_jax.deploy.link.rapid_program import RapidProgram
from bt_jax.deploy.link.rws import Rws
from bt_jax.deploy.link.settings import LinkTiming, link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.rws_server import RwsLimits
from tests.helpers.rws import client, served


def stopper(server):
    return ProgramStop(client(server, timeout=0.2, back_off=()), retry=0.05)


def busy(controller, server):
    state = server.RequestHandlerClass.state
    state.limits = RwsLimits(rate=0.0)
    return lambda: setattr(state, "limits", RwsLimits(rate=math.inf))


def hanging(controller, server):
    controller.hang = 30.0
    return controller.free.set


def running_on(controller, server):
    controller.stops = False
    return lambda: setattr(controller, "stops", True)


@pytest.mark.parametrize("fault", [busy, hanging, running_on])
def test_it_is_tried_until_it_is_confirmed(fault):
    with served(RwsLimits(rate=math.inf)) as (controller, server):
        stop = stopper(server)
        heal = fault(controller, server)
        stop.begin()
        assert not stop.wait(0.6), "whatever was answered, the program runs"
        assert controller.rapid
        heal()
        assert stop.wait(3.0)
        assert not controller.rapid
        stop.close()


def test_a_program_that_has_stopped_is_believed_though_the_request_to_stop_it_is_refused():
    """As after somebody has switched to manual mode."""
    with served(RwsLimits(rate=math.inf)) as (controller, server):
        controller.mode = "MANR"
        stop = stopper(server)
        stop.begin()
        assert not stop.wait(0.3), "the program runs"
        controller.rapid = False
        assert stop.wait(3.0)
        assert any(line.endswith("403") for _, line in server.requests)
        assert controller.stop_requests == 0
        stop.close()


def test_an_error_that_nobody_expects_ends_no_stop(monkeypatch):
    def break_down(rws):
        raise RuntimeError("odd")

    with served(RwsLimits(rate=math.inf)) as (controller, server):
        stop = stopper(server)
        with monkeypatch.context() as patch:
            patch.setattr(Rws, "stop", break_down)
            stop.begin()
            assert not stop.wait(0.3)
        assert stop.wait(3.0)
        assert not controller.rapid
        stop.close()


def exit_thread(rws):
    raise SystemExit


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_stop_that_is_asked_for_again_is_tried_again(monkeypatch):
    """Whatever has ended the tries before."""
    with served(RwsLimits(rate=math.inf)) as (_, server):
        stop = stopper(server)
        with monkeypatch.context() as patch:
            patch.setattr(Rws, "stop", exit_thread)
            stop.begin()
            assert not stop.wait(0.3)
        stop.begin()
        assert stop.wait(3.0)
        stop.close()


def test_it_waits_for_no_reading_that_hangs():
    with served() as (controller, server):
        program = RapidProgram(link_config(YUMI, "127.0.0.1", {"left": 6511, "right": 6512}, server.server_address[1]))
        program.expect_stop()
        lost = []
        watch = ControllerWatch(program, LinkTiming(), enabled=lambda: True, stop=lost.append, look=lambda: None)
        controller.hang = 30.0
        watch.start()
        time.sleep(0.5)  # a reading hangs by now, and will for 2 s
        controller.free.set()
        controller.free.clear()
        controller.hang = 0.0
        began = time.monotonic()
        program.stop()
        assert program.stopped(1.0)
        assert time.monotonic() - began < 0.5
        watch.close()
        program.close()


def test_a_watched_controller_is_asked_at_most_ten_times_a_second():
    with served() as (_, server):
        program = RapidProgram(link_config(YUMI, "127.0.0.1", {"left": 6511, "right": 6512}, server.server_address[1]))
        program.state()
        watch = ControllerWatch(program, LinkTiming(), enabled=lambda: True, stop=lambda _: "", look=lambda: None)
        watch.start()
        for opening in (0.0, 0.02, 0.04, 0.01):
            program.grip("left", opening, 10.0)
            time.sleep(0.5)
        watch.close()
        program.close()
        times = [when for when, _ in server.requests]
        assert len(times) > 12
        assert all(sum(start <= each < start + 0.97 for each in times) <= 10 for start in times)


def test_what_the_controller_says_is_read_from_its_event_log():
    with served() as (controller, server):
        program = RapidProgram(
            link_config(YUMI, "127.0.0.1", {"left": 6511, "right": 6512}, server.server_address[1]), realtime=False
        )
        program.expect_stop()
        assert program.complaint() is None
        controller.messages.append(type(controller.messages[0])(2, 3, 50204, "Motion supervision"))
        controller.messages.append(type(controller.messages[0])(3, 1, 10125, "Program stopped"))
        assert program.complaint() == "50204 Motion supervision"
        program.close()
