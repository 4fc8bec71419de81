"""Puts together what is known of the cell: poses from the camera, openings from the grippers, and what is held."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.line_of_sight import in_the_way
from bt_jax.deploy.execution.observation import Finding, Observation
from bt_jax.deploy.execution.settings import GraspSettings
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.robot.arrays import Joints
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
    `links(arm, joints)` are the origins of an arm's links in chain order, then the point between the fingers, in the base
    frame [m]."""

    def __init__(
        self,
        task: Task,
        *,
        link: RobotLink,
        perception: Perceiving,
        grasped: Callable[[], Mapping[str, str]],
        links: Callable[[str, Joints], Float[np.ndarray, "links 3"]],
        grasp: GraspSettings | None = None,
    ) -> None:
        self.grasp = grasp or GraspSettings()
        self.link, self.perception, self.grasped, self.links = link, perception, grasped, links
        self._sizes = {box.name: box.size for box in task.boxes}
        self._before: dict[str, float] = {}
        self._trails: dict[str, deque[tuple[float, Float[np.ndarray, "links 3"]]]] = {arm: deque() for arm in link.arms}

    def __call__(self) -> Observation:
        self.perception.update()
        now = self.link.now()
        poses = dict(self.perception.poses(now))
        arms = {arm: self.link.arm(arm) for arm in self.link.arms}
        opening = {arm: state.opening for arm, state in arms.items()}
        for arm, state in arms.items():
            self._trails[arm].append((now, self.links(arm, state.joints)))
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
            tuple(finding for finding in self.perception.findings(now) if not self._hides(finding)),
            self.perception.measured(),
        )

    def _hides(self, finding: Finding) -> bool:
        """Is an arm, or was it just now, between the camera and what a finding says is not seen?"""
        trails = (points for trail in self._trails.values() for _, points in trail)
        return bool(finding.sight) and any(in_the_way(points, finding.sight) for points in trails)

    def _in_hand(self, pose: RigidTransform | None, arm: str, size: float) -> bool:
        """Is the box where the fingers are, or were just now? Assumed if it is not seen."""
        if pose is None:
            return True
        return any(
            np.linalg.norm(points[-1] - pose.translation) <= size / 2 + self.grasp.near
            for _, points in self._trails[arm]
        )
