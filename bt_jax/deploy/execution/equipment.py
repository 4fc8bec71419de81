"""The parts of a real cell, as far as they could be opened."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, TypeVar, runtime_checkable

from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.observer import Perceiving
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.link.realtime import may_take_priority
from bt_jax.deploy.link.reception import Reception
from bt_jax.deploy.link.rws import ControllerState
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.link.settings import LinkConfig
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.robot.model import RobotModel

__all__ = ["CheckedLink", "Equipment", "opened"]

Part = TypeVar("Part")


def opened(part: Part | UserError | None, absent: str = "") -> Part:
    """Return a part. Raise UserError if it could not be opened, or with `absent` if it was not given."""
    if part is None:
        raise UserError(absent)
    if isinstance(part, UserError):
        raise part
    return part


@runtime_checkable
class CheckedLink(RobotLink, Protocol):
    """What is asked of a link before anything moves."""

    config: LinkConfig
    rules: Rules

    def reception(self, arm: str) -> Reception:
        """Return what came to the port of an arm so far."""

    def elsewhere(self) -> dict[int, str]:
        """Return the ports, other than ours, to which something comes, with the address of its sender."""

    def state(self) -> ControllerState:
        """Return the controller's state, asked for now."""


@dataclasses.dataclass(frozen=True)
class Equipment:
    """What is to be checked. A part that is missing (None), or could not be opened (an error), makes its own item fail, and
    hides none that does without it."""

    robot: RobotModel
    program: Program | UserError
    rules: Rules | UserError
    config: LinkConfig  # of the link, or of the one that would be opened
    link: CheckedLink | UserError
    flange: Callable[[str, Joints], RigidTransform]  # our forward kinematics: arm, joints -> tool0 in the base
    perception: Perceiving | UserError | None
    intrinsics_error: float | UserError | None  # pixels
    camera_residual: float | UserError | None  # metres
    reachable: Callable[[str, Observation], bool]
    twin_log: Path | None
    gripper_mass: float | None = None  # kg with fingers, where it differs from that of the model
    may_take_priority: Callable[[], bool] = may_take_priority  # on this computer

    def now(self) -> float:
        """Return the time [s]: of the link, if there is one."""
        return time.monotonic() if isinstance(self.link, UserError) else self.link.now()

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        if isinstance(self.link, UserError):
            time.sleep(seconds)
        else:
            self.link.wait(self.link.now() + seconds)
