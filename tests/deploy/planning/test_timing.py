import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toppra.algorithm import TOPPRA

from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI

ARM = YUMI.arm("left")


@given(scale=st.floats(1e-4, 0.5), seed=st.integers(0, 10_000), count=st.integers(2, 5), share=st.floats(0.1, 1.0))
@settings(max_examples=25, deadline=None)
def test_trajectories_keep_speed_and_acceleration_and_end_where_they_should(seed, count, share, scale):
    rng = np.random.default_rng(seed)
    path = rng.uniform(ARM.lower, ARM.upper, (count, 7)) * scale
    pace = Pace(share=share)
    trajectory = timed(path, pace, ARM)
    np.testing.assert_array_equal(trajectory.joints[[0, -1]], path[[0, -1]])
    speeds = trajectory.speeds()
    assert np.all(np.abs(speeds) <= share * ARM.speed * (1 + 1e-6) + 1e-9)
    rests = np.concatenate([np.zeros((1, 7)), speeds, np.zeros((1, 7))])
    assert np.abs(np.diff(rests, axis=0) / trajectory.times[1]).max() <= pace.acceleration * ARM.acceleration[0] * 1.001
    tips = np.array([ARM.forward(joints).translation for joints in trajectory.joints])
    assert (np.linalg.norm(np.diff(tips, axis=0), axis=1) / np.diff(trajectory.times)).max() <= pace.tool * (1 + 1e-9)


def test_a_straight_path_is_not_left():
    a, b = np.zeros(7), np.linspace(0.2, -0.6, 7)
    for joints in timed(np.stack([a, b]), Pace(), ARM).joints:
        part = joints @ b / (b @ b)
        np.testing.assert_allclose(joints, part * b, atol=1e-12)


def test_a_path_to_where_the_arm_is_takes_no_time():
    assert timed(np.zeros((2, 7)), Pace(), ARM).duration == 0


@pytest.mark.parametrize("scale", [1e-9, 1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
def test_steps_of_any_size_are_timed(scale):
    here = YUMI.home["left"]
    for way in np.random.default_rng(1).normal(0, 1, (3, 7)):
        for path in (
            [here, here + scale * way],
            [here, here + scale * way, here + 0.1 * way],
            [here, here + 0.1 * way],
        ):
            trajectory = timed(np.array(path), Pace().slowed(0.3), ARM)
            np.testing.assert_allclose(trajectory.joints[[0, -1]], np.array(path)[[0, -1]], atol=1e-6)


def test_many_small_steps_make_a_way():
    path = np.outer(np.linspace(0, 1e-4, 1000), np.ones(7))
    np.testing.assert_array_equal(timed(path, Pace(), ARM).joints[-1], path[-1])


def test_where_no_way_to_run_is_found_there_is_no_plan(monkeypatch):
    monkeypatch.setattr(TOPPRA, "compute_parameterization", lambda *_: (None, None, None))
    with pytest.raises(Unplannable, match="TOPP-RA"):
        timed(np.stack([np.zeros(7), np.ones(7)]), Pace(), ARM)


def test_corners_are_rounded_near_them_only():
    corner = np.array([[0, 0], [1, 0], [1, 1.0]]) @ np.eye(7)[:2]
    quick, exact = timed(corner, Pace(), ARM), timed(corner, Pace(), ARM, round_from=0.0)
    for trajectory, most in ((quick, 0.1), (exact, 1e-12)):
        x, y = trajectory.joints[:, 0], trajectory.joints[:, 1]
        away = np.minimum(np.abs(y), np.abs(1 - x))
        assert 0 <= away.max() <= most
        np.testing.assert_array_equal(trajectory.joints[:, 2:], 0)
    assert quick.duration < exact.duration
    assert (np.abs(exact.joints - corner[1]).max(axis=1) < 1e-9).any(), "it comes to rest at the corner"


def test_a_pace_that_is_half_as_fast_takes_twice_as_long_or_less():
    path = np.stack([np.zeros(7), np.linspace(0.2, -0.6, 7)])
    full, half = (timed(path, Pace().slowed(factor), ARM).duration for factor in (1.0, 0.5))
    assert full < half < 2 * full
