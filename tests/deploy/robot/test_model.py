"""Whatever the robot: URDF, MJCF and our forward kinematics agree."""

import dataclasses
import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from bt_jax.deploy.robot.mjcf import add_to_mjcf
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.urdf import urdf
from bt_jax.deploy.robot.yumi import YUMI
from tests.helpers.six_axis import SIX_AXIS, denavit_hartenberg


def mujoco_model(robot: RobotModel) -> mujoco.MjModel:
    root = ET.fromstring(
        '<mujoco><compiler angle="radian"/><asset><material name="scene/shell"/><material name="scene/rubber"/></asset>'
        "<worldbody/></mujoco>"
    )
    add_to_mjcf(robot, root, (0.0, 0.0, 0.0))
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


@pytest.mark.parametrize("robot", [YUMI, SIX_AXIS], ids=lambda robot: robot.name)
def test_urdf_mjcf_and_numpy_have_the_same_forward_kinematics(robot):
    model, rng = pin.buildModelFromXML(urdf(robot)), np.random.default_rng(0)
    data, q = model.createData(), pin.neutral(model)
    twin = mujoco_model(robot)
    state = mujoco.MjData(twin)
    for _ in range(100):
        joints = {arm.name: rng.uniform(arm.lower, arm.upper) for arm in robot.arms}
        for arm in robot.arms:
            for name, value in zip(arm.joint_names, joints[arm.name], strict=True):
                q[model.joints[model.getJointId(name)].idx_q] = value
                state.joint(name).qpos = value
        pin.framesForwardKinematics(model, data, q)
        mujoco.mj_kinematics(twin, state)
        for arm in robot.arm_names:
            ours = robot.forward(arm, joints[arm]).as_matrix()
            site = state.site(f"{arm}_tcp")
            theirs = data.oMf[model.getFrameId(f"{arm}_tcp")].homogeneous
            np.testing.assert_allclose(theirs, ours, atol=1e-9)
            np.testing.assert_allclose(site.xpos, ours[:3, 3], atol=1e-9)
            np.testing.assert_allclose(site.xmat.reshape(3, 3), ours[:3, :3], atol=1e-9)
            flange = robot.flange(arm, joints[arm]).translation
            np.testing.assert_allclose(flange, state.site(f"{arm}_tool0").xpos, atol=1e-9)


def test_the_flange_of_six_joints_is_where_denavit_and_hartenberg_put_it():
    rng = np.random.default_rng(1)
    for _ in range(20):
        joints = rng.uniform(-np.pi, np.pi, 6)
        np.testing.assert_allclose(SIX_AXIS.flange("arm", joints).as_matrix(), denavit_hartenberg(joints), atol=1e-12)


def test_an_arm_has_a_home_for_each_joint():
    with pytest.raises(ValueError, match="6 joints, and its home 7"):
        dataclasses.replace(SIX_AXIS.arm("arm"), home=(0.0,) * 7)
