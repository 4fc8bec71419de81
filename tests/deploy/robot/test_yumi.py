import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from bt_jax.deploy.robot.mjcf import add_to_mjcf
from bt_jax.deploy.robot.urdf import urdf
from bt_jax.deploy.robot.yumi import AXES, CALIBRATION, YUMI

ABB = {"left": [0, -130, 30, 0, 40, 0, 135], "right": [0, -130, 30, 0, 40, 0, -135]}  # calibration pose, axes 1 to 7


def mujoco_model():
    root = ET.fromstring(
        '<mujoco><compiler angle="radian"/><asset><material name="shell"/><material name="rubber"/></asset>'
        "<worldbody/></mujoco>"
    )
    add_to_mjcf(YUMI, root, (0.0, 0.0, 0.0))
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def test_urdf_mjcf_and_numpy_have_the_same_forward_kinematics():
    model, rng = pin.buildModelFromXML(urdf(YUMI)), np.random.default_rng(0)
    data, q = model.createData(), pin.neutral(model)
    twin = mujoco_model()
    state = mujoco.MjData(twin)
    for _ in range(100):
        joints = {arm: rng.uniform(YUMI.arm("left").lower, YUMI.arm("left").upper) for arm in YUMI.arm_names}
        for arm in YUMI.arm_names:
            for name, value in zip(YUMI.arm(arm).joint_names, joints[arm], strict=True):
                q[model.joints[model.getJointId(name)].idx_q] = value
                state.joint(name).qpos = value
        pin.framesForwardKinematics(model, data, q)
        mujoco.mj_kinematics(twin, state)
        for arm in YUMI.arm_names:
            ours = YUMI.forward(arm, joints[arm]).as_matrix()
            site = state.site(f"{arm}_tcp")
            theirs = data.oMf[model.getFrameId(f"{arm}_tcp")].homogeneous
            np.testing.assert_allclose(theirs, ours, atol=1e-9)
            np.testing.assert_allclose(site.xpos, ours[:3, 3], atol=1e-9)
            np.testing.assert_allclose(site.xmat.reshape(3, 3), ours[:3, :3], atol=1e-9)
            np.testing.assert_allclose(
                YUMI.flange(arm, joints[arm]).translation, state.site(f"{arm}_tool0").xpos, atol=1e-9
            )


@pytest.mark.parametrize("arm", YUMI.arm_names)
def test_the_calibration_pose_is_abbs_in_chain_order(arm):
    assert [ABB[arm][axis - 1] for axis in AXES] == pytest.approx(np.degrees(CALIBRATION[arm]).tolist())


def test_the_arms_are_mirror_images():
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    signs = np.array([-1, 1, -1, 1, -1, 1, -1])
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(YUMI.arm("left").lower, YUMI.arm("left").upper)
        left, right = YUMI.forward("left", q).as_matrix(), YUMI.forward("right", signs * q).as_matrix()
        np.testing.assert_allclose(mirror @ left @ mirror, right, atol=1e-6)
