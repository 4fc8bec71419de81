"""Puts together what is known of the cell: poses from the camera, openings from the grippers, and what is held."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.settings import GraspSettings
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.robot.arrays import Joints, Point
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
    """Make an `Observation` at every call. `grasped()` names the box that each arm was told to grasp and not to release;
    `tcp(arm, joints)` is the pose of the point between the fingers, in the base frame."""

    def __init__(
        self,
        task: Task,
        *,
        link: RobotLink,
        perception: Perceiving,
        grasped: Callable[[], Mapping[str, str]],
        tcp: Callable[[str, Joints], RigidTransform],
        grasp: GraspSettings | None = None,
    ) -> None:
        self.grasp = grasp or GraspSettings()
        self.link, self.perception, self.grasped, self.tcp = link, perception, grasped, tcp
        self._sizes = {box.name: box.size for box in task.boxes}
        self._before: dict[str, float] = {}
        self._trails: dict[str, deque[tuple[float, Point]]] = {arm: deque() for arm in link.arms}

    def __call__(self) -> Observation:
        self.perception.update()
        now = self.link.now()
        poses = dict(self.perception.poses(now))
        arms = {arm: self.link.arm(arm) for arm in self.link.arms}
        opening = {arm: state.opening for arm, state in arms.items()}
        for arm, state in arms.items():
            self._trails[arm].append((now, self.tcp(arm, state.joints).translation))
            while self._trails[arm][0][0] < now - self.grasp.trail:
                self._trails[arm].popleft()
        holding = None
        for arm, box in self.grasped().items():
            state, size = arms[arm], self._sizes[box]
            blocked = state.grip_target <= size - self.grasp.squeeze and abs(state.opening - size) <= self.grasp.fit
            steady = abs(state.opening - self._before.get(arm, np.inf)) <= self.grasp.steady
            if blocked and steady and self._in_hand(poses.get(box), arm, size):
                holding = box
        self._before = opening
        return Observation(
            now,
            poses,
            opening,
            holding,
            self.perception.image,
            self.perception.lost,
            self.perception.findings(now),
            self.perception.measured(),
        )

    def _in_hand(self, pose: RigidTransform | None, arm: str, size: float) -> bool:
        """Is the box where the fingers are, or were just now? Assumed if it is not seen."""
        if pose is None:
            return True
        return any(
            np.linalg.norm(point - pose.translation) <= size / 2 + self.grasp.near for _, point in self._trails[arm]
        )
