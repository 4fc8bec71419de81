import numpy as np
import pytest

from bt_jax.deploy.link.egm import Feedback, Mci
from bt_jax.deploy.link.shared_state import MotionState, SharedState


@pytest.mark.parametrize("count", [6, 7])
def test_states_and_cycles_are_read_as_they_were_written_whatever_the_number_of_joints(count):
    state = SharedState(("arm",), count)
    measured, velocity, commanded = (np.arange(count) + start for start in (0.1, 0.2, 0.3))
    flange = np.array([0.4, 0.5, 0.6, 1.0, 0.0, 0.0, 0.0])
    feedback = Feedback(17, 2.5, measured, None, True, Mci.RUNNING, True, flange)
    assert state.read_arm("arm", opening=0.0, grip_target=0.0) is None
    state.write_arm("arm", feedback, velocity, commanded, MotionState(moving=True, motion=3, remaining=0.7))
    state.record("arm", feedback, commanded)
    read = state.read_arm("arm", opening=0.03, grip_target=0.04)
    assert (read.time, read.moving, read.motion, read.remaining, read.running) == (2.5, True, 3, 0.7, True)
    np.testing.assert_array_equal([read.joints, read.velocity, read.commanded], [measured, velocity, commanded])
    np.testing.assert_allclose(read.flange.translation, flange[:3])
    rows, count_of_all = state.records(0)
    assert count_of_all == 1
    np.testing.assert_array_equal(rows, [[0, 2.5, *commanded, *measured, 17]])
