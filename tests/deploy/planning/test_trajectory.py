import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.planning.trajectory import HALT, Follower, Trajectory


@st.composite
def trajectories(draw):
    count = draw(st.integers(1, 8))
    gaps = draw(st.lists(st.floats(0.01, 1.0), min_size=count - 1, max_size=count - 1))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return Trajectory(np.cumsum([0.0, *gaps]), rng.uniform(-1, 1, (count, 7)))


@given(trajectories(), st.floats(-1, 9))
def test_interpolates_as_numpy(trajectory, time):
    expected = [np.interp(time, trajectory.times, joint) for joint in trajectory.joints.T]
    np.testing.assert_allclose(trajectory.at(time), expected, atol=1e-12)


@given(trajectories())
def test_following_reaches_the_end_in_time(trajectory):
    follower, cycles = Follower(trajectory), 0
    while not follower.done:
        joints = follower.advance(CYCLE)
        cycles += 1
        np.testing.assert_allclose(joints, trajectory.at(cycles * CYCLE), atol=1e-9)
    assert cycles == pytest.approx(trajectory.duration / CYCLE, abs=1.01)
    assert follower.remaining == 0


@given(trajectories(), st.floats(0, 1))
def test_halting_stays_on_the_path_and_only_slows_down(trajectory, share):
    follower = Follower(trajectory)
    for _ in range(int(share * trajectory.duration / CYCLE)):
        follower.advance(CYCLE)
    follower.halt()
    times, cycles = [], 0
    while not follower.done:
        joints = follower.advance(CYCLE)
        times.append(follower._time)
        np.testing.assert_array_equal(joints, trajectory.at(follower._time))
        cycles += 1
    assert cycles * CYCLE <= HALT + 2 * CYCLE
    steps = np.diff(times)
    assert np.all(steps >= 0)
    assert np.all(np.diff(steps) <= 1e-12)


@given(trajectories(), st.floats(1, 10))
def test_slowing_changes_the_time_not_the_path(trajectory, factor):
    slow = trajectory.slowed(factor)
    np.testing.assert_array_equal(slow.joints, trajectory.joints)
    np.testing.assert_allclose(slow.speeds() * factor, trajectory.speeds(), rtol=1e-9)


@pytest.mark.parametrize(
    ("times", "joints"),
    [([0, 1], np.zeros(2)), ([0], np.zeros((2, 7))), ([1, 2], np.zeros((2, 7))), ([0, 0], np.zeros((2, 7)))],
)
def test_what_is_no_trajectory_is_refused(times, joints):
    with pytest.raises((UserError, TypeCheckError), match="trajectory"):  # checked types refuse a shape first
        Trajectory(np.array(times, float), joints)
