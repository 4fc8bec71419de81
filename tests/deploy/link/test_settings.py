"""What the link knows of a robot comes from its model."""

import pytest

from bt_jax.deploy.link.rapid_program import MILLIMETRES, RapidProgram
from bt_jax.deploy.link.settings import link_config
from bt_jax.deploy.robot.yumi import YUMI
from tests.helpers.six_axis import ARM, SIX_AXIS


@pytest.mark.parametrize("robot", [YUMI, SIX_AXIS])
def test_fingers_are_sent_as_far_and_as_strongly_as_their_gripper_can(robot, monkeypatch):
    written = []
    ports = {arm: 6511 + i for i, arm in enumerate(robot.arm_names)}
    program = RapidProgram(link_config(robot, "127.0.0.1", ports))
    monkeypatch.setattr(program._rws, "set_number", lambda symbol, value: written.append(value))
    for arm in robot.arms:
        program.grip(arm.name, 1.0, 1000.0)
        assert written[-2:] == [arm.gripper.force, MILLIMETRES * arm.gripper.opening]
    assert ARM.gripper.opening != YUMI.arms[0].gripper.opening


def test_each_arm_has_a_port():
    with pytest.raises(ValueError, match="six_axis has the arms arm, and ports are for left, right"):
        link_config(SIX_AXIS, "127.0.0.1", {"left": 6511, "right": 6512})
