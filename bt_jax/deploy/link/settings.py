"""Where the controller is, and how long the link waits for whom."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

__all__ = ["EGM_SPEED", "LinkConfig", "LinkTiming"]

EGM_SPEED = math.radians(15.0)  # rad/s: the RAPID program BtJax lets EGM turn a joint no faster


@dataclasses.dataclass(frozen=True)
class LinkTiming:
    """Time-outs and periods of the link, in seconds."""

    startup: float = 30.0  # for the link process to come up, and for its answers where time is simulated
    answer: float = 1.0  # for its answer to a command by the clock: it looks 500 times as often
    guided: float = 5.0  # for the arms to follow once the program was started
    poll: float = 0.2  # between two readings of a gripper in real time
    state: float = 1.5  # between two readings of the controller's state, which EGM tells sooner
    silent: float = 2.0  # without an answer to such a reading, until the robot is stopped
    attempt: float = 0.5  # for the controller to answer a request to stop its program
    retry: float = 0.15  # between two requests to stop it
    confirm: float = 1.5  # for it to confirm that it has stopped, until a person is asked to press the stop
    ramp: float = 0.5  # for the robot's program to end guided motion: a look at the gripper, and its ramp
    idle: float = 0.002  # between two looks at the watchdog while no message comes
    elsewhere: float = 0.5  # for which other ports are listened to where nothing comes
    parting: float = 0.5  # for which the arms are still held when the program above is gone


@dataclasses.dataclass(frozen=True)
class LinkConfig:
    """Where the controller is. The ports are ours: the controller must be set up to send each arm's EGM there."""

    host: str = "192.168.125.1"  # the service port of an IRC5
    ports: Mapping[str, int] = dataclasses.field(default_factory=lambda: {"left": 6511, "right": 6512})
    rws_port: int = 80
    user: str = "Default User"
    password: str = "robotics"
    widest: float = 0.05  # m between the fingers, and the strongest grip in N: of the Smart Gripper
    strongest: float = 20.0
    motion: bool = False  # False: listen only; no setpoint ever leaves
    timing: LinkTiming = LinkTiming()
