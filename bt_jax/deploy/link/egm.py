"""Externally Guided Motion: what the controller and its client say to each other every 4 ms, as Protocol Buffers over UDP.

The messages are those of ABB's egm.proto (`egm_messages`). On the wire: degrees, controller time in ms. Six axes
travel as `joints`; a seventh, the third of the chain (ABB's axis 7), as the first of `externalJoints`.
"""

from __future__ import annotations

import dataclasses
import enum
from typing import Any

import numpy as np
from google.protobuf.message import DecodeError

from bt_jax.deploy.link.egm_messages import EgmRobot, EgmSensor
from bt_jax.deploy.robot.arrays import Joints, PoseRow

__all__ = ["CYCLE", "EXTERNAL", "SIX", "Feedback", "Mci", "Setpoint", "WrongAxes"]

CYCLE = 0.004  # seconds between two messages
SIX = 6  # joints of a message; further axes are external
EXTERNAL = 2  # place in the chain of a seventh axis, which travels as an external joint
DATA, CORRECTION = 2, 3  # kinds of messages
_SEQUENCE = 1 << 32  # numbers wrap here


class WrongAxes(ValueError):
    """A message that is not about the axes that an arm has."""

    def __init__(self, axes: int, joints: int, external: int) -> None:
        super().__init__(f"expected {SIX} joints and {axes - SIX} external, found {joints} and {external}")
        self.joints, self.external = joints, external


class Mci(enum.IntEnum):
    """State of the controller's motion interface."""

    UNDEFINED = 0
    ERROR = 1
    STOPPED = 2
    RUNNING = 3


@dataclasses.dataclass(frozen=True)
class Feedback:
    """What the controller says of one arm; joints in chain order [rad]."""

    sequence: int
    time: float  # seconds of the controller's clock
    joints: Joints  # measured
    planned: Joints | None  # what the controller is about to reach; None if it does not send it
    motors_on: bool
    mci: Mci
    rapid_running: bool
    flange: PoseRow | None = None  # in the base frame; None if the controller does not send it
    stamp: float | None = None  # seconds of the measurement, finer than `time`, since whenever; None if not sent

    @property
    def running(self) -> bool:
        """May the arm be moved through EGM now?"""
        return self.motors_on and self.rapid_running and self.mci == Mci.RUNNING

    def encode(self) -> bytes:
        """Return the message EgmRobot."""
        message = EgmRobot()
        _header(message.header, self.sequence, self.time, DATA)
        seconds = int(self.time)
        for part, joints in ((message.feedBack, self.joints), (message.planned, self.planned)):
            if joints is None:
                continue
            _write_joints(part, joints)
            part.time.sec, part.time.usec = seconds, int(1e6 * (self.time - seconds))
        if self.flange is not None:
            pose = message.feedBack.cartesian
            pose.pos.x, pose.pos.y, pose.pos.z = (1000 * self.flange[:3]).tolist()
            turn = pose.orient
            turn.u0, turn.u1, turn.u2, turn.u3 = self.flange[3:].tolist()
        message.motorState.state = 1 if self.motors_on else 2
        message.mciState.state = int(self.mci)
        message.rapidExecState.state = 2 if self.rapid_running else 1
        message.mciConvergenceMet = False
        message.utilizationRate = 0.0
        return message.SerializeToString()

    @staticmethod
    def decode(data: bytes, axes: int) -> Feedback:
        """Read EgmRobot. Raise ValueError if it is not one, WrongAxes if it is not about so many axes (6 or 7)."""
        message = EgmRobot()
        _parse(message, data)
        return Feedback(
            message.header.seqno,
            message.header.tm / 1000,
            _read_joints(message.feedBack, axes),
            _read_joints(message.planned, axes) if message.HasField("planned") else None,
            message.motorState.state == 1,
            Mci(message.mciState.state),
            message.rapidExecState.state == 2,
            _read_pose(message.feedBack) if message.feedBack.HasField("cartesian") else None,
            message.feedBack.time.sec + message.feedBack.time.usec / 1e6 if message.feedBack.HasField("time") else None,
        )


@dataclasses.dataclass(frozen=True)
class Setpoint:
    """Where an arm should be in the next cycle; joints in chain order [rad]."""

    sequence: int
    time: float  # seconds of the feedback that it answers
    joints: Joints

    def encode(self) -> bytes:
        """Return the message EgmSensor."""
        message = EgmSensor()
        _header(message.header, self.sequence, self.time, CORRECTION)
        _write_joints(message.planned, self.joints)
        return message.SerializeToString()

    @staticmethod
    def decode(data: bytes, axes: int) -> Setpoint:
        """Read EgmSensor. Raise ValueError if it is not one, WrongAxes if it is not about so many axes (6 or 7)."""
        message = EgmSensor()
        _parse(message, data)
        return Setpoint(message.header.seqno, message.header.tm / 1000, _read_joints(message.planned, axes))


def _parse(message: Any, data: bytes) -> None:
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise ValueError(f"not an EGM message: {error}") from error


def _header(header: Any, sequence: int, time: float, kind: int) -> None:
    header.seqno = sequence % _SEQUENCE
    header.tm = round(1000 * time) % _SEQUENCE
    header.mtype = kind


def _write_joints(part: Any, joints: Joints) -> None:
    degrees = np.degrees(joints).tolist()
    if len(degrees) > SIX:
        part.externalJoints.joints.append(degrees.pop(EXTERNAL))
    part.joints.joints.extend(degrees)


def _read_pose(part: Any) -> PoseRow | None:
    position, turn = part.cartesian.pos, part.cartesian.orient
    quaternion = np.array([turn.u0, turn.u1, turn.u2, turn.u3])
    if not 0.99 < np.linalg.norm(quaternion) < 1.01:  # Euler angles were asked for, or nothing
        return None
    return np.concatenate([np.array([position.x, position.y, position.z]) / 1000, quaternion])


def _read_joints(part: Any, axes: int) -> Joints:
    six, more = part.joints.joints, part.externalJoints.joints
    if len(six) != SIX or len(more) < axes - SIX:
        raise WrongAxes(axes, len(six), len(more))
    degrees = list(six)
    if axes > SIX:
        degrees.insert(EXTERNAL, more[0])
    return np.radians(degrees)
