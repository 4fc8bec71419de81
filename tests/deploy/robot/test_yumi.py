import numpy as np
import pytest

from bt_jax.deploy.robot.yumi import AXES, CALIBRATION, YUMI

ABB = {"left": [0, -130, 30, 0, 40, 0, 135], "right": [0, -130, 30, 0, 40, 0, -135]}  # calibration pose, axes 1 to 7


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
