import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.mjx_env.render.grasps import grasps
from bt_jax.mjx_env.scene.mjcf import PAD, gripper_unit
from bt_jax.tasks import load_task
from tests.helpers.samples import MIXED

TASK = load_task(MIXED)
UPRIGHT, ON_ITS_SIDE = (1, 0, 0, 0), (math.sqrt(0.5), math.sqrt(0.5), 0, 0)


def pose(quaternion=UPRIGHT, turn=0.0):
    w, x, y, z = quaternion
    c, s = math.cos(turn / 2), math.sin(turn / 2)
    return np.array([0, 0, 1, c * w - s * z, c * x - s * y, c * y + s * x, c * z + s * w])


@given(turn=st.floats(-3, 3))
@settings(max_examples=20)
def test_fingers_close_on_faces_that_fit_the_opening_the_narrow_ones_first(turn):
    first, second = grasps(TASK, TASK.thing("Plate"), pose(turn=turn))
    assert (first.width, second.width) == pytest.approx((0.1, 0.2))
    assert math.remainder(first.yaw - turn - math.pi / 2, math.pi) == pytest.approx(0, abs=1e-6)
    assert math.remainder(second.yaw - turn, math.pi) == pytest.approx(0, abs=1e-6)


def test_a_cylinder_is_taken_from_any_side_and_a_lying_one_across():
    can = TASK.thing("Can")
    assert {grasp.width for grasp in grasps(TASK, can, pose())} == {0.06}
    assert len({round(grasp.yaw, 3) for grasp in grasps(TASK, can, pose())}) >= 4
    (across,) = grasps(TASK, can, pose(ON_ITS_SIDE))
    assert math.remainder(across.yaw, math.pi) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("name", ["Plate", "Brick", "Can", "Cube", "Bolt1"])
@pytest.mark.parametrize("quaternion", [UPRIGHT, ON_ITS_SIDE])
def test_pads_stay_over_what_the_object_stands_on(name, quaternion):
    thing = TASK.thing(name)
    half = (thing.size[2] if quaternion == UPRIGHT else thing.size[1]) / 2
    for grasp in grasps(TASK, thing, pose(quaternion)):
        assert grasp.lift - PAD * gripper_unit(TASK) > -half
        assert grasp.width <= TASK.gripper_opening
