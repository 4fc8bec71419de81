"""Where the controller is, and how long the link waits for whom."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from bt_jax.deploy.robot.model import GripperModel, RobotModel

__all__ = ["EGM_SPEED", "LinkConfig", "LinkTiming", "link_config"]

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
    """Where the controller is, and what the arms' grippers can do. The ports are ours: the controller must be set up to send
    each arm's EGM there."""

    host: str
    ports: Mapping[str, int]
    grippers: Mapping[str, GripperModel]
    rws_port: int = 80
    user: str = "Default User"
    password: str = "robotics"
    motion: bool = False  # False: listen only; no setpoint ever leaves
    timing: LinkTiming = LinkTiming()


def link_config(
    robot: RobotModel, host: str, ports: Mapping[str, int], rws_port: int = LinkConfig.rws_port, **others: Any
) -> LinkConfig:
    """Return where the controller of a robot is. Raise ValueError unless each of its arms has a port."""
    if set(ports) != set(robot.arm_names):
        raise ValueError(
            f"{robot.name} has the arms {', '.join(robot.arm_names)}, and ports are for {', '.join(ports)}"
        )
    return LinkConfig(host, ports, {arm.name: arm.gripper for arm in robot.arms}, rws_port, **others)
