import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.twin.servo import SetpointFilter
from bt_jax.deploy.twin.settings import Realism

START = np.linspace(-1, 1, 7)


def follow(realism, setpoints):
    """The references for setpoints, one a cycle."""
    found = SetpointFilter(realism, START)
    references = []
    for i, setpoint in enumerate(setpoints):
        found.take(setpoint, i * CYCLE)
        references.append(found.advance(i * CYCLE))
    return np.array(references)


def test_a_perfect_arm_is_where_the_newest_setpoint_is():
    setpoints = START + np.linspace(0, 1, 50)[:, None]
    np.testing.assert_array_equal(follow(Realism.perfect(), setpoints), setpoints)


def test_an_arm_trails_behind_a_steady_motion_by_delay_and_lag():
    realism = dataclasses.replace(Realism.perfect(), egm_delay=0.02, egm_lag=0.05)
    speed = 0.5
    setpoints = START + speed * CYCLE * np.arange(200)[:, None]
    references = follow(realism, setpoints)
    np.testing.assert_array_equal(references[:5], np.tile(START, (5, 1)))
    behind = (setpoints[-1] - references[-1]) / speed
    np.testing.assert_allclose(behind, 0.07, atol=2 * CYCLE)


def test_an_arm_comes_to_rest_without_overshoot_though_setpoints_are_under_way():
    realism = Realism()
    filtered = SetpointFilter(realism, START)
    for i in range(100):
        filtered.take(START + 0.002 * i, i * CYCLE)
        before = filtered.advance(i * CYCLE)
    filtered.brake()
    rest = np.array([filtered.advance((100 + i) * CYCLE) for i in range(100)])
    steps = np.diff(np.vstack([before, rest]), axis=0)
    assert steps.max() <= 0.0021
    assert np.all(np.diff(steps, axis=0) < 1e-9), "speed only falls"
    assert np.abs(steps[-1]).max() < 1e-6
    assert (rest[-1] < START + 0.002 * 99).all(), "and what was under way is not gone to"


def test_no_joint_turns_faster_than_the_program_lets_it():
    realism = dataclasses.replace(Realism.perfect(), egm_speed=0.25)
    references = follow(realism, np.tile(START + 0.1, (200, 1)))
    assert np.abs(np.diff(references, axis=0)).max() == pytest.approx(0.25 * CYCLE)
    assert np.count_nonzero(np.abs(references - START - 0.1).max(axis=1) > 1e-9) * CYCLE == pytest.approx(0.4, abs=0.01)
