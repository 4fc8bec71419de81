"""What comes to the ports of EGM and is of no use is told apart, in a link to something that is no YuMi."""

import re
import socket
import time

import numpy as np
import pytest

from bt_jax.deploy.link import irc5_link, reception
from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.egm_messages import EgmRobot
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.reception import Receiver, Reception, complaint
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.cells import RULES, cell

HOST, STRANGER = "127.0.0.1", "127.0.0.2"


def message(sequence: int) -> bytes:
    return Feedback(sequence, CYCLE * sequence, np.zeros(7), None, True, Mci.RUNNING, True).encode()


def six_axes(sequence: int) -> bytes:
    robot = EgmRobot.FromString(message(sequence))
    robot.feedBack.ClearField("externalJoints")
    return robot.SerializeToString()


@pytest.fixture(scope="module")
def link():
    """A link to Robot Web Services; what comes to its ports is up to the test."""
    with (
        Controller(cell(), ports=free_ports(YUMI.arm_names), realtime=False) as controller,
        Irc5Link(link_config(YUMI, HOST, free_ports(YUMI.arm_names), controller.rws_port), RULES) as link,
    ):
        yield link


def received(link, source: str, messages: list[bytes]) -> tuple[Reception, Reception]:
    """What came to the left arm's port before these messages, and after them."""
    before = link.reception("left")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        for data in messages:
            sender.sendto(data, (HOST, link.config.ports["left"]))
    deadline = time.monotonic() + 10
    after = before
    while _count(after.since(before)) < len(messages) and time.monotonic() < deadline:
        time.sleep(0.01)
        after = link.reception("left")
    assert _count(after.since(before)) == len(messages)
    return before, after


def _count(came: Reception) -> int:
    return came.taken + came.old + came.foreign + came.axes + came.unreadable


@pytest.mark.parametrize(
    ("source", "make", "told"),
    [
        (HOST, six_axes, "5 EGM messages .* with 6 joints and 0 external ones .* --robot"),
        (STRANGER, message, "5 messages .* from 127.0.0.2 and none from 127.0.0.1; .* --robot"),
        (HOST, lambda _: b"hello, robot", "5 messages .* not of EGM; .* --ports"),
    ],
)
def test_what_is_of_no_use_is_told(link, source, make, told):
    before, after = received(link, source, [make(number) for number in range(5)])
    found = complaint("left", link.config.ports["left"], HOST, before, after, 1.0, axes=7)
    assert re.search(told, found), found


def test_an_arm_of_six_axes_is_told_what_it_should_guide():
    came = Reception(axes=5, joints=6, external=1)
    found = complaint("arm", 6511, HOST, Reception(), came, 1.0, axes=6)
    assert "meant for the arm, with 6 joints and 1 external ones instead of 6 and 0" in found
    assert "must guide 6 axes" in found
    assert not re.search("arm arm|axis 7|BtJax|both", found)


def test_numbers_that_do_not_rise_are_told(link):
    received(link, HOST, [message(9)])
    before, after = received(link, HOST, [message(9)] * 5)
    assert "do not rise; restart" in complaint("left", 6511, HOST, before, after, 1.0, axes=7)


def test_messages_at_another_port_are_heard(link, monkeypatch):
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        other.bind((HOST, 0))
        port = other.getsockname()[1]
        monkeypatch.setattr(irc5_link, "USUAL_PORTS", (port, link.config.ports["left"]))
        monkeypatch.setattr(reception, "open_socket", lambda number: {port: other}[number].dup())
        sender.sendto(message(1), (HOST, port))
        assert link.elsewhere() == {port: HOST}
        assert link.elsewhere() == {}


GOOD = {"taken": 250, "sequence": 250, "time": 1.0}


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({}, None),
        ({"axes": 2, "old": 1}, None),
        ({"sources": 200}, "two senders .* a port of its own"),
        ({"unreadable": 100}, "another kind"),
        ({"taken": 42, "sequence": 42}, "every 24 ms instead of every 4; set SampleRate"),
        ({"time": float("nan")}, "SampleRate"),
        ({"taken": 200}, "only 200 of 250 messages .* 50 were lost; use a cable"),
        ({"taken": 100, "sequence": 100, "time": 0.4}, "only 100 of 250 messages .* 0 were lost"),
    ],
)
def test_how_often_messages_come_is_judged(changes, told):
    before = Reception(taken=1000, sequence=1000, time=4.0)
    came = Reception(**(GOOD | changes))
    after = Reception(
        **{name: value + getattr(before, name) for name, value in vars(came).items()},
    )
    found = complaint("left", 6511, HOST, before, after, 1.0, axes=7)
    assert found is None if told is None else re.search(told, found), found


def receptions(*runs: range, period: float) -> list[Reception]:
    """What a receiver has counted before any message, and after each run of numbers, sent every `period` seconds."""
    receiver, found, time = Receiver(), [Reception()], 0.0
    for numbers in runs:
        for number in numbers:
            time += period
            receiver.take((HOST, 1), number, time)
        found.append(Reception.of(receiver.reception.numbers()))
    return found


def test_a_slow_rate_is_told_also_where_nothing_came_before():
    before, after = receptions(range(700, 742), period=0.024)
    found = complaint("left", 6511, HOST, before, after, 1.0, axes=7)
    assert "every 24 ms instead of every 4; set SampleRate" in found
    before, after = receptions(range(700, 950), period=CYCLE)
    assert complaint("left", 6511, HOST, before, after, 1.0, axes=7) is None
    before, after = receptions(range(700, 1200, 2), period=2 * CYCLE)
    assert "249 were lost" in complaint("left", 6511, HOST, before, after, 2.0, axes=7)


@pytest.mark.parametrize("start", [1, (1 << 31) - 100])
def test_numbers_that_begin_again_are_no_losses(start):
    """The controller was started again while its messages were counted."""
    _, before, after = receptions(range((1 << 32) - 200, 1 << 32), range(1, 251), period=CYCLE)
    assert complaint("left", 6511, HOST, before, after, 1.0, axes=7) is None, "they only wrap"
    _, before, after = receptions(range(start + 5000, start + 5100), range(start, start + 250), period=CYCLE)
    assert complaint("left", 6511, HOST, before, after, 1.0, axes=7) is None
    _, before, after = receptions(range(start + 5000, start + 5100), range(start, start + 42), period=0.024)
    assert "every 24 ms" in complaint("left", 6511, HOST, before, after, 1.0, axes=7)
