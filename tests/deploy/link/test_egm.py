import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from hypothesis import given
from hypothesis import strategies as st

from bt_jax.deploy.link.egm import Feedback, Mci, Setpoint
from bt_jax.deploy.link.egm_messages import MESSAGES, EgmRobot, EgmSensor


def joints_of(axes: int) -> st.SearchStrategy:
    return st.lists(st.floats(-5, 5), min_size=axes, max_size=axes).map(np.array)


TWO = st.sampled_from([6, 7]).flatmap(lambda axes: st.tuples(joints_of(axes), joints_of(axes)))


@given(TWO, st.integers(0, 2**32 - 1), st.integers(0, 10**9), st.sampled_from(Mci), st.booleans())
def test_feedback_round_trip(two, sequence, milliseconds, mci, flag):
    joints, planned = two
    sent = Feedback(sequence, milliseconds / 1000, joints, planned, flag, mci, not flag)
    got = Feedback.decode(sent.encode(), len(joints))
    np.testing.assert_allclose(got.joints, joints, atol=1e-12)
    np.testing.assert_allclose(got.planned, planned, atol=1e-12)
    assert (got.sequence, got.motors_on, got.rapid_running, got.mci) == (sequence, flag, not flag, mci)
    assert got.time == pytest.approx(milliseconds / 1000)


@given(st.sampled_from([6, 7]).flatmap(joints_of), st.integers(0, 2**32 - 1))
def test_setpoint_round_trip(joints, sequence):
    got = Setpoint.decode(Setpoint(sequence, 1.25, joints).encode(), len(joints))
    np.testing.assert_allclose(got.joints, joints, atol=1e-12)
    assert (got.sequence, got.time) == (sequence, 1.25)


def test_the_flange_travels_in_millimetres_with_the_scalar_first():
    flange = np.array([0.1, 0.2, 0.3, 0.8544, 0.5, 0.1, 0.1])
    flange[3:] /= np.linalg.norm(flange[3:])
    sent = Feedback(1, 0.0, np.zeros(7), np.zeros(7), True, Mci.RUNNING, True, flange)
    message = EgmRobot()
    message.ParseFromString(sent.encode())
    assert message.feedBack.cartesian.pos.y == pytest.approx(200)
    assert message.feedBack.cartesian.orient.u0 == flange[3]
    assert message.feedBack.cartesian.orient.u1 == flange[4]
    assert Feedback.decode(sent.encode(), 7).flange == pytest.approx(flange)


def test_what_is_planned_need_not_be_told():
    sent = Feedback(1, 0.0, np.ones(7), None, True, Mci.RUNNING, True)
    got = Feedback.decode(sent.encode(), 7)
    assert got.planned is None
    assert got.running
    np.testing.assert_allclose(got.joints, 1.0)


def test_axis_seven_travels_as_the_external_joint_in_degrees():
    message = EgmSensor()
    message.ParseFromString(Setpoint(7, 0.0, np.radians([10, 20, 70, 30, 40, 50, 60])).encode())
    assert list(message.planned.joints.joints) == pytest.approx([10, 20, 30, 40, 50, 60])
    assert list(message.planned.externalJoints.joints) == pytest.approx([70])
    assert message.header.mtype == 3


@pytest.mark.parametrize("data", [b"", b"\xff\xff\xff", b"hello, robot", EgmRobot().SerializeToString()])
def test_what_is_no_message_is_refused(data):
    with pytest.raises(ValueError, match=r"EGM|joints"):
        Feedback.decode(data, 7)
    with pytest.raises(ValueError, match=r"EGM|joints"):
        Setpoint.decode(data, 7)


def test_six_axes_are_refused_of_an_arm_of_seven():
    message = EgmRobot()
    message.feedBack.joints.joints.extend([0.0] * 6)
    with pytest.raises(ValueError, match="external"):
        Feedback.decode(message.SerializeToString(), 7)
    assert Feedback.decode(message.SerializeToString(), 6).joints.shape == (6,)


@pytest.fixture(scope="module")
def theirs():
    """The messages as ABBRobotEGM has compiled them from ABB's file: the oracle."""
    return pytest.importorskip("ABBRobotEGM._egm_protobuf.egm_pb2", reason="ABBRobotEGM is not installed")


FLANGES = st.none() | st.lists(st.floats(-2, 2), min_size=3, max_size=3).map(
    lambda p: np.array([*p, 0.5, 0.5, 0.5, 0.5])
)


@given(
    joints_of(7),
    joints_of(7),
    st.integers(0, 2**32 - 1),
    st.integers(0, 10**9),
    st.sampled_from(Mci),
    st.booleans(),
    FLANGES,
)
def test_feedback_has_the_bytes_of_abbs_messages(theirs, joints, planned, sequence, ms, mci, flag, flange):
    ours = Feedback(sequence, ms / 1000, joints, planned, flag, mci, not flag, flange).encode()
    message = theirs.EgmRobot.FromString(ours)
    assert message.SerializeToString() == ours
    assert not message.FindInitializationErrors()
    assert message.header.mtype == theirs.EgmHeader.MSGTYPE_DATA
    assert message.motorState.state == (theirs.EgmMotorState.MOTORS_ON if flag else theirs.EgmMotorState.MOTORS_OFF)
    assert theirs.EgmMCIState.MCIStateType.Name(message.mciState.state) == f"MCI_{mci.name}"
    rapid = theirs.EgmRapidCtrlExecState.RapidCtrlExecStateType.Name(message.rapidExecState.state)
    assert rapid == ("RAPID_STOPPED" if flag else "RAPID_RUNNING")


@given(st.sampled_from([6, 7]).flatmap(joints_of), st.integers(0, 2**32 - 1))
def test_setpoints_have_the_bytes_of_abbs_messages(theirs, joints, sequence):
    ours = Setpoint(sequence, 1.25, joints).encode()
    message = theirs.EgmSensor.FromString(ours)
    assert message.SerializeToString() == ours
    assert message.header.mtype == theirs.EgmHeader.MSGTYPE_CORRECTION


def test_what_we_leave_out_of_a_message_is_no_hindrance(theirs):
    message = theirs.EgmRobot.FromString(Feedback(7, 1.0, np.ones(7), np.ones(7), True, Mci.RUNNING, True).encode())
    message.moveIndex = 4
    message.feedBack.timeStamp.sec = 9
    message.feedBack.cartesian.euler.x = message.feedBack.cartesian.euler.y = message.feedBack.cartesian.euler.z = 1.0
    message.measuredForce.force.extend([1.0, 2.0])
    message.torqueRef.joints.extend([1.0] * 6)
    got = Feedback.decode(message.SerializeToString(), 7)
    assert (got.sequence, got.running, got.flange) == (7, True, None)
    np.testing.assert_allclose(got.joints, 1.0)


@pytest.mark.parametrize("name", MESSAGES)
def test_every_field_is_abbs(theirs, name):
    def fields(descriptor):
        proto = descriptor_pb2.DescriptorProto()
        descriptor.CopyToProto(proto)
        kinds = {f.TYPE_ENUM: f.TYPE_INT32 for f in proto.field}
        return {f.name: (f.number, f.label, kinds.get(f.type, f.type), _message(f)) for f in proto.field}

    def _message(field):
        return field.type_name if field.type == field.TYPE_MESSAGE else ""

    ours = fields(EgmRobot.DESCRIPTOR.file.message_types_by_name[name])
    assert ours.items() <= fields(getattr(theirs, name).DESCRIPTOR).items()
