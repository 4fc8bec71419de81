"""A stop in mid-carry, and what a person can do about it, in the twin with its physics; boxes are seen as they are."""

import dataclasses

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.settings import Realism
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
BOX = "BlueBox"  # not the first of those of this size


def poses(scene, controller):
    data = mujoco.MjData(scene.model)
    data.qpos[:] = controller.state()[1]
    mujoco.mj_kinematics(scene.model, data)
    base = RigidTransform.from_translation(TASK.robot_position).inv()
    found = {}
    for name in (*TASK.object_names, TASK.kits[0].name):
        body = data.body(name)
        turn = Rotation.from_quat(body.xquat, scalar_first=True)
        found[name] = base * RigidTransform.from_components(body.xpos, turn)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("keep", [False, True])
def test_a_part_that_a_stop_left_in_the_fingers_is_let_go_of_or_taken_home(keep):
    scene, ports = build_scene(YUMI, TASK, 3, Realism.perfect()), free_ports(YUMI.arm_names)
    rules = dataclasses.replace(cell_rules(YUMI, TASK), idle=60.0)
    with Controller(scene.cell, ports=ports, realtime=False, realism=scene.realism) as controller:
        config = link_config(YUMI, "127.0.0.1", ports, controller.rws_port, motion=True)

        def drive(link, skills, *, until=lambda: False):
            for _ in range(600):
                seen = Observation(
                    link.now(),
                    poses(scene, controller),
                    {arm: link.arm(arm).opening for arm in YUMI.arm_names},
                    next(iter(skills.grasped.values()), None),
                )
                status = skills.poll(seen)
                if status != Status.RUNNING or until():
                    return status
                link.wait(link.now() + 0.1)
            raise AssertionError("still running after a minute")

        def height():
            return poses(scene, controller)[BOX].translation[2]

        with Irc5Link(config, rules, controller) as link:
            link.start()
            skills = RobotSkills(YUMI, TASK, link)
            skills.start(parse_behavior(f"pick({BOX})"), Observation(link.now(), poses(scene, controller), {}, None))
            rest = height()
            drive(link, skills, until=lambda: height() > rest + 0.01)
            assert link.stop("somebody shouted") == ""
        with Irc5Link(config, rules, controller) as link:
            assert link.state().rapid == "stopped"
            assert height() > rest + 0.01, "the fingers hold it while everything is stopped"
            link.start(here=True)
            skills = RobotSkills(YUMI, TASK, link)
            skills.recover(keep=keep)
            assert drive(link, skills) == Status.SUCCESS, skills.reason
            for arm in YUMI.arm_names:
                np.testing.assert_allclose(link.arm(arm).joints, YUMI.home[arm], atol=0.06)
            assert (height() > rest + 0.05) == keep
            assert link.stopped() is None
