"""What skills and executor see of a robot: the state of its arms, and the protocol by which they are moved."""

from __future__ import annotations

import dataclasses
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.arrays import Joints

__all__ = ["ArmState", "ControllerGone", "Counters", "Records", "RobotLink", "SimulatedController"]


Records = Float[np.ndarray, "n fields"]
"""Cycles for the log, one a row: arm, time [s], setpoints of all joints, measured joints, sequence number; joints in rad."""


class ControllerGone(Exception):
    """The twin's controller has ended, or no longer answers: simulated time stands still."""


@dataclasses.dataclass(frozen=True)
class ArmState:
    """One arm; joints in chain order."""

    time: float  # of the controller's clock, s
    joints: Joints  # measured
    velocity: Joints  # rad/s
    commanded: Joints  # the last setpoint
    moving: bool  # follows a path
    motion: int  # number of the path that was accepted last
    remaining: float  # seconds to the end of the path
    running: bool  # the controller would move it
    flange: RigidTransform | None  # pose in the base frame as the controller tells it
    opening: float  # of the gripper, m between the fingers
    grip_target: float  # m, as asked for last


@dataclasses.dataclass(frozen=True)
class Counters:
    """What the link counted; messages of all arms together."""

    cycles: int  # messages answered
    missed: int  # answers that could not be sent
    late: int  # messages that waited for more than a cycle
    lost: int
    reordered: int
    clipped: int  # setpoints whose step was too large
    rejected: int  # paths that broke a rule


@runtime_checkable
class RobotLink(Protocol):
    """What skills and executor need of a robot. All waiting goes through `wait`, so that time may be simulated."""

    arms: tuple[str, ...]

    def now(self) -> float:
        """Return the time, s."""

    def wait(self, until: float) -> None:
        """Let time pass until then [s], and tell the robot that the program is alive."""

    def arm(self, arm: str) -> ArmState:
        """Return the newest state of an arm."""

    def stopped(self) -> str | None:
        """Return why a protective stop was latched, None if none was."""

    def follow(self, arm: str, trajectory: Trajectory) -> int:
        """Start a path at once and return its number. Raise Rejected if it breaks a rule; then nothing moves."""

    def halt(self, arm: str) -> None:
        """Bring an arm smoothly to rest on its path."""

    def interrupt(self) -> None:
        """Bring all arms to rest on their paths, for good; may be called from a signal handler."""

    def grip(self, arm: str, opening: float, force: float = 10.0) -> None:
        """Move a gripper's fingers to a distance [m] from each other, with a force [N]."""

    def stop(self, reason: str) -> str:
        """Latch a protective stop: the arms hold from now on. Return what must be added to the reason: that the robot has
        not confirmed it, or what the robot says itself; "" if nothing."""

    def counters(self) -> Counters:
        """Return what was counted so far."""


@runtime_checkable
class SimulatedController(Protocol):
    """What the link asks of a controller whose time it may drive: the twin's."""

    realtime: bool

    def advance(self, until: float) -> None:
        """Let the controller's time pass [s]. Raise ControllerGone if its process has ended."""

    def state(self) -> tuple[float, Float[np.ndarray, " nq"]]:
        """Return the controller's time [s] and its latest state."""
