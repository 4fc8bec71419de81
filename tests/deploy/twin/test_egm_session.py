"""Between telling the position and guided motion the controller is silent for a while, and counts from 1 again."""

import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.rws import EGM_REQUEST, EGM_STATE, Motion, symbol
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.simulated_robot import SimulatedRobot
from tests.helpers.cells import RULES, cell, move, run_for

SILENT = 0.1
REALISM = dataclasses.replace(Realism.perfect(), egm_restart=SILENT)


def messages(robot, arm, cycles):
    """What an arm says in so many cycles; None where it is silent."""
    said = []
    arm.network.send = lambda message, _: said.append(Feedback.decode(message, 7))
    found = []
    for _ in range(cycles):
        said.clear()
        robot.step()
        robot.speak()
        found.append(said[0] if said else None)
    return found


@pytest.mark.parametrize(("realism", "silent"), [(REALISM, SILENT), (Realism.perfect(), 0.0)], ids=["real", "perfect"])
def test_a_new_session_begins_after_a_silence(realism, silent):
    robot = SimulatedRobot(cell(), free_ports(YUMI.arm_names), realism)
    arm = robot.arms[0]
    robot.start_rapid()
    told = messages(robot, arm, 20)
    assert {message.mci for message in told} == {Mci.STOPPED}
    robot.set_number(symbol(arm.name, EGM_REQUEST), float(Motion.GUIDED))
    state = robot.number(symbol(arm.name, EGM_STATE))
    assert state == (Motion.LISTEN if silent else Motion.GUIDED)
    told = messages(robot, arm, 50)
    first = next(i for i, message in enumerate(told) if message is not None)
    assert first == pytest.approx(silent / CYCLE, abs=1)
    assert {message.mci for message in told[first:]} == {Mci.RUNNING}
    assert told[first].sequence == (1 if silent else 21)
    np.testing.assert_array_equal(np.diff([message.sequence for message in told[first:]]), 1)
    assert robot.number(symbol(arm.name, EGM_STATE)) == Motion.GUIDED


def test_our_link_begins_guided_motion_through_the_silence():
    ports = free_ports(YUMI.arm_names)
    with Controller(cell(), ports=ports, realtime=False, realism=REALISM) as controller:
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)
        with Irc5Link(config, RULES, controller) as link:
            controller.advance(1.0)
            link.start()
            start = link.arm("left").joints
            move(link, "left", 0.2)
            run_for(link, 1.5)
            np.testing.assert_allclose(link.arm("left").joints, start + 0.2, atol=2e-3)
            assert link.stopped() is None
