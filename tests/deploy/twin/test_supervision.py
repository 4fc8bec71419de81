"""The twin's motion supervision, in a cell with the real robot's twin and without a network."""

import dataclasses
import math

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE, Mci
from bt_jax.deploy.link.rws import EGM_REQUEST, GRIP_TARGET, Motion, symbol
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.settings import Realism
from bt_jax.deploy.twin.simulated_robot import SimulatedRobot
from bt_jax.deploy.twin.supervision import ContactSupervision
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
REAL = dataclasses.replace(Realism(), egm_restart=0.0)  # guided motion begins at once


def guided(realism):
    """A robot whose left arm follows setpoints."""
    robot = SimulatedRobot(build_scene(YUMI, TASK, 3, realism).cell, free_ports(YUMI.arm_names), realism)
    assert robot.start_rapid()
    for arm in robot.arms:
        robot.set_number(symbol(arm.name, EGM_REQUEST), float(Motion.GUIDED))
        arm.silent = -math.inf  # nobody speaks over the network here
    return robot, robot.arms[0]


def turn(robot, arm, joint, angle, seconds):
    """Turn one joint; return the force on the arm in each cycle, N."""
    start, forces = robot.data.ctrl[arm.actuators].copy(), []
    felt = ContactSupervision(robot.model, {arm.name: arm.joint_ids})
    for i in range(round(seconds / CYCLE)):
        setpoint = start.copy()
        setpoint[joint] += angle * min(1.0, 2 * i * CYCLE / seconds)
        if arm.mci == Mci.RUNNING:
            arm.setpoints.take(setpoint, robot.time)
        robot.step()
        forces.append(felt.advance(robot.data)[arm.name])
    return forces


def into_the_table(contact):
    robot, arm = guided(dataclasses.replace(REAL, contact=contact))
    return robot, arm, turn(robot, arm, 1, -1.2, 4.0)


def test_an_arm_that_meets_something_stops_gives_way_and_tells_why():
    robot, arm, forces = into_the_table(60.0)
    assert [(message.kind, message.code) for message in robot.messages] == [(3, 50204)]
    assert arm.name in robot.messages[0].title
    assert (robot.rapid, arm.mci, robot.control) == (False, Mci.ERROR, "motoron")
    assert max(forces) < 200
    assert forces[-1] < 10, "it presses no more"
    at_rest = robot.data.qpos[arm.joints].copy()
    turn(robot, arm, 1, -0.2, 0.5)
    np.testing.assert_allclose(robot.data.qpos[arm.joints], at_rest, atol=1e-3)
    assert robot.start_rapid(), "a person can start the program again"


def test_without_supervision_the_arm_presses_on():
    robot, _, forces = into_the_table(math.inf)
    assert max(forces) > 200
    assert robot.rapid
    assert not robot.messages


def test_free_motion_and_a_grasp_are_no_contact():
    robot, arm = guided(REAL)
    forces = turn(robot, arm, 0, 0.4, 1.0)
    robot.set_number(symbol(arm.name, GRIP_TARGET), 0.0)
    forces += turn(robot, arm, 0, 0.0, 1.5)
    assert max(forces) < 1.0
    assert robot.rapid
    assert robot.data.qpos[arm.fingers].max() == pytest.approx(0.0, abs=1e-3)
