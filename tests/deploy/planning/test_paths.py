import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax.deploy.planning.paths import Pace, connect, densified, timed
from bt_jax.deploy.robot.yumi import YUMI

ARM = YUMI.arm("left")


@given(seed=st.integers(0, 10_000), count=st.integers(2, 5), share=st.floats(0.1, 1.0))
@settings(max_examples=40, deadline=None)
def test_trajectories_keep_speed_and_acceleration_and_end_where_they_should(seed, count, share):
    rng = np.random.default_rng(seed)
    path = rng.uniform(ARM.lower, ARM.upper, (count, 7)) * 0.5
    pace = Pace(share=share)
    trajectory = timed(path, pace, ARM)
    np.testing.assert_array_equal(trajectory.joints[[0, -1]], path[[0, -1]])
    speeds = trajectory.speeds()
    assert np.all(np.abs(speeds) <= share * ARM.speed * (1 + 1e-6) + 1e-9)
    rests = np.concatenate([np.zeros((1, 7)), speeds, np.zeros((1, 7))])
    assert np.abs(np.diff(rests, axis=0) / trajectory.times[1]).max() <= pace.acceleration * 1.3
    tips = np.array([ARM.forward(joints).translation for joints in trajectory.joints])
    assert (np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(trajectory.times)).max() <= pace.tool * (1 + 1e-9)


def test_a_straight_path_is_not_left():
    a, b = np.zeros(7), np.linspace(0.2, -0.6, 7)
    for joints in timed(np.stack([a, b]), Pace(), ARM).joints:
        part = joints @ b / (b @ b)
        np.testing.assert_allclose(joints, part * b, atol=1e-12)


def test_a_path_to_where_the_arm_is_takes_no_time():
    assert timed(np.zeros((2, 7)), Pace(), ARM).duration == 0


@pytest.mark.parametrize("seed", range(5))
def test_ways_around_an_obstacle_are_free(seed):
    centre = np.full(7, 0.1)

    def free(joints):
        return bool(np.linalg.norm(joints - centre) > 0.3)

    start, goal = np.full(7, -0.3), np.full(7, 0.5)
    path = connect(start, goal, free, ARM, seed=seed)
    np.testing.assert_array_equal(path[[0, -1]], np.stack([start, goal]))
    assert all(free(joints) for joints in densified(path))
    assert connect(start, centre, free, ARM) is None, "the goal itself is not free"
