"""Puts together what is known of the cell: poses from the camera, openings from the grippers, and what is held."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.line_of_sight import LineOfSight
from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.settings import GraspSettings
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.planning.grasps import grip_widths
from bt_jax.deploy.planning.pose_geometry import distance_between
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["Observer", "Perceiving"]


@runtime_checkable
class Perceiving(Protocol):
    """What sees the objects."""

    def update(self) -> None:
        """Take a new image into account; raise if no image can come any more."""

    def poses(self, now: float) -> Mapping[str, RigidTransform]:
        """Fresh poses in the robot's base frame; what is not in it is unknown."""

    @property
    def image(self) -> float:
        """Time of the newest image, s."""

    @property
    def lost(self) -> str:
        """Why there is no newer one, "" if nothing is known to be wrong."""

    def findings(self, now: float) -> tuple[Finding, ...]:
        """Return what is wrong with what the pictures show, as of `now` [s]."""

    def measured(self) -> Mapping[str, float]:
        """Return when each object was measured last [s], however long ago."""


class Observer:
    """Make an `Observation` at every call. `grasped()` names what each arm was told to grasp and not to release."""

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        *,
        link: RobotLink,
        perception: Perceiving,
        grasped: Callable[[], Mapping[str, str]],
        grasp: GraspSettings | None = None,
    ) -> None:
        self.grasp = grasp or GraspSettings()
        self.robot, self.link, self.perception, self.grasped = robot, link, perception, grasped
        self._line_of_sight = LineOfSight(robot, task)
        self._things = {thing.name: thing for thing in task.objects}
        self._before: dict[str, float] = {}
        self._taken: dict[str, float] = {}  # box -> when it was grasped last [s]
        self._trail: deque[tuple[float, dict[str, Joints]]] = deque()  # of the joints of all arms

    def __call__(self) -> Observation:
        self.perception.update()
        now = self.link.now()
        poses = dict(self.perception.poses(now))
        arms = {arm: self.link.arm(arm) for arm in self.link.arms}
        opening = {arm: state.opening for arm, state in arms.items()}
        self._trail.append((now, {arm: state.joints for arm, state in arms.items()}))
        while self._trail[0][0] < now - self.grasp.trail:
            self._trail.popleft()
        holding = None
        for arm, box in self.grasped().items():
            self._taken[box] = now
            state, thing = arms[arm], self._things[box]
            blocked = any(
                state.grip_target <= width - self.grasp.squeeze and abs(state.opening - width) <= self.grasp.fit
                for width in grip_widths(thing, self.robot.arm(arm).gripper.opening)
            )
            steady = abs(state.opening - self._before.get(arm, np.inf)) <= self.grasp.steady
            if blocked and steady and self._in_hand(poses.get(box), arm, thing.edge):
                holding = box
        self._before = opening
        measured = self.perception.measured()
        return Observation(
            now,
            poses,
            opening,
            holding,
            self.perception.image,
            self.perception.lost,
            tuple(
                f for f in self.perception.findings(now) if not (self._took(f, measured) or self._hides(f, measured))
            ),
            measured,
        )

    def _took(self, finding: Finding, measured: Mapping[str, float]) -> bool:
        """Is a box missing because it was grasped since it was measured last?"""
        return finding.missing and self._taken.get(finding.about, -np.inf) >= measured.get(finding.about, -np.inf)

    def _hides(self, finding: Finding, measured: Mapping[str, float]) -> bool:
        """Is an arm, or was it since what a finding is about was seen, between the camera and what it does not see?"""
        if not finding.sight:
            return False
        since = measured.get(finding.about, -np.inf) if finding.missing else -np.inf
        margin = self.grasp.beside if finding.missing else self.grasp.before
        trail = (joints for time, joints in self._trail if time > since)
        return any(self._line_of_sight.blocked(joints, finding.sight, margin) for joints in trail)

    def _in_hand(self, pose: RigidTransform | None, arm: str, size: float) -> bool:
        """Is the box where the fingers are, or were just now? Assumed if it is not seen."""
        if pose is None:
            return True
        return any(
            distance_between(self.robot.forward(arm, joints[arm]), pose) <= size / 2 + self.grasp.near
            for _, joints in self._trail
        )
