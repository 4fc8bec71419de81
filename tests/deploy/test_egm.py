import numpy as np
import pytest
from ABBRobotEGM._egm_protobuf import egm_pb2
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.deploy.egm import Feedback, Mci, Setpoint

JOINTS = st.lists(st.floats(-5, 5), min_size=7, max_size=7).map(np.array)


@given(JOINTS, JOINTS, st.integers(0, 2**32 - 1), st.integers(0, 10**9), st.sampled_from(Mci), st.booleans())
def test_feedback_round_trip(joints, planned, sequence, milliseconds, mci, flag):
    sent = Feedback(sequence, milliseconds / 1000, joints, planned, flag, mci, not flag)
    got = Feedback.decode(sent.encode())
    np.testing.assert_allclose(got.joints, joints, atol=1e-12)
    np.testing.assert_allclose(got.planned, planned, atol=1e-12)
    assert (got.sequence, got.motors_on, got.rapid_running, got.mci) == (sequence, flag, not flag, mci)
    assert got.time == pytest.approx(milliseconds / 1000)


@given(JOINTS, st.integers(0, 2**32 - 1))
def test_setpoint_round_trip(joints, sequence):
    got = Setpoint.decode(Setpoint(sequence, 1.25, joints).encode())
    np.testing.assert_allclose(got.joints, joints, atol=1e-12)
    assert (got.sequence, got.time) == (sequence, 1.25)


def test_the_flange_travels_in_millimetres_with_the_scalar_first():
    flange = np.array([0.1, 0.2, 0.3, 0.5, 0.1, 0.1, 0.8544])
    flange[3:] /= np.linalg.norm(flange[3:])
    sent = Feedback(1, 0.0, np.zeros(7), np.zeros(7), True, Mci.RUNNING, True, flange)
    message = egm_pb2.EgmRobot()
    message.ParseFromString(sent.encode())
    assert message.feedBack.cartesian.pos.y == pytest.approx(200)
    assert message.feedBack.cartesian.orient.u0 == flange[6]
    assert Feedback.decode(sent.encode()).flange == pytest.approx(flange)


def test_axis_seven_travels_as_the_external_joint_in_degrees():
    message = egm_pb2.EgmSensor()
    message.ParseFromString(Setpoint(7, 0.0, np.radians([10, 20, 70, 30, 40, 50, 60])).encode())
    assert list(message.planned.joints.joints) == pytest.approx([10, 20, 30, 40, 50, 60])
    assert list(message.planned.externalJoints.joints) == pytest.approx([70])
    assert message.header.mtype == egm_pb2.EgmHeader.MSGTYPE_CORRECTION


@pytest.mark.parametrize("data", [b"", b"\xff\xff\xff", b"hello, robot", egm_pb2.EgmRobot().SerializeToString()])
def test_what_is_no_message_is_refused(data):
    with pytest.raises(ValueError, match=r"EGM|joints"):
        Feedback.decode(data)
    with pytest.raises(ValueError, match=r"EGM|joints"):
        Setpoint.decode(data)


def test_six_axes_are_refused():
    message = egm_pb2.EgmRobot()
    message.feedBack.joints.joints.extend([0.0] * 6)
    with pytest.raises(ValueError, match="external"):
        Feedback.decode(message.SerializeToString())
