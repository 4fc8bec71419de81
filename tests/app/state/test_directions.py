"""Where a person carries and turns what is in the gripper."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.app.state.directions import DIRECTIONS, TURN_STEP, as_seen, next_turn, vector
from bt_jax.tasks import load_task

ways = st.sampled_from((-1, 1))


@given(st.floats(-180, 180), ways)
def test_the_next_round_angle_is_at_most_one_step_away(turn, way):
    found = next_turn(turn, way)
    assert found == TURN_STEP * round(found / TURN_STEP)
    assert 0 < way * (found - turn) <= 1.01 * TURN_STEP


@given(st.integers(-12, 12), ways, st.floats(-1e-3, 1e-3))
def test_from_a_round_angle_it_is_one_step(steps, way, noise):
    assert next_turn(steps * TURN_STEP + noise, way) == pytest.approx((steps + way) * TURN_STEP)


@pytest.mark.parametrize("quarter", range(4))
@pytest.mark.parametrize("direction", DIRECTIONS)
def test_keys_follow_a_view_that_is_turned(direction, quarter):
    task, turn = load_task("stack"), math.radians(90 * quarter)
    x, y, z = vector(task, direction)
    seen = (x * math.cos(turn) - y * math.sin(turn), x * math.sin(turn) + y * math.cos(turn), z)
    np.testing.assert_allclose(vector(task, as_seen(direction, quarter)), seen, atol=1e-9)
