"""Which boxes no arm can grasp where they are. Inverse kinematics takes time: only a box that moved is asked for again."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.action_runner import Skills
from bt_jax.deploy.execution.observation import Observation

__all__ = ["ReachMemory"]

MOVED = 0.005  # metres or radians by which a box must move before it is asked again whether it can be reached


class ReachMemory:
    """Remembers what the skills have answered for the boxes in `names`."""

    def __init__(self, skills: Skills, names: Iterable[str]) -> None:
        self.skills, self.names = skills, tuple(names)
        self._answers: dict[str, tuple[RigidTransform, bool]] = {}

    def unreachable(self, seen: Observation, *, ask: bool) -> frozenset[str]:
        """Return the boxes out of reach, as far as is known; nothing new is found out unless `ask`."""
        return frozenset(name for name in self.names if not self._reachable(name, seen, ask))

    def known_unreachable(self) -> list[str]:
        """Return the boxes that were out of reach when they were asked for last."""
        return [name for name, (_, answer) in self._answers.items() if not answer]

    def _reachable(self, name: str, seen: Observation, ask: bool) -> bool:
        pose, before = seen.poses.get(name), self._answers.get(name)
        if pose is None or not ask:
            return before is None or before[1]
        if before is not None:
            change = before[0].inv() * pose
            if max(np.linalg.norm(change.translation), change.rotation.magnitude()) < MOVED:
                return before[1]
        answer = self.skills.reachable(name, seen)
        self._answers[name] = (pose, answer)
        return answer
