"""What the robot knows at one moment: the only thing that conditions and skills look at."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from scipy.spatial.transform import RigidTransform, Rotation

__all__ = ["Observation"]


@dataclasses.dataclass(frozen=True)
class Observation:
    """The cell as it is known at `time` [s]. What is not in `poses` is unknown, and nothing may be taken for true of it."""

    time: float
    poses: Mapping[str, RigidTransform]  # of boxes and kit, in the robot's base frame [m]; fresh ones only
    opening: Mapping[str, float]  # of each arm's gripper: m between the fingers
    holding: str | None  # the box that is held
    image: float = math.inf  # time of the newest camera image, s
    lost: str = ""  # why there is no newer one; "" where that is not known

    def to_dict(self) -> dict[str, Any]:
        """For the log; poses as position [m] and quaternion (x, y, z, w)."""
        poses = {
            name: [*pose.translation.tolist(), *pose.rotation.as_quat().tolist()] for name, pose in self.poses.items()
        }
        image = None if math.isinf(self.image) else self.image
        return {
            "time": self.time,
            "poses": poses,
            "opening": dict(self.opening),
            "holding": self.holding,
            "image": image,
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Observation:
        """Reads what `to_dict` gives."""
        poses = {
            name: RigidTransform.from_components(values[:3], Rotation.from_quat(values[3:]))
            for name, values in data["poses"].items()
        }
        image = math.inf if data["image"] is None else data["image"]
        return Observation(data["time"], poses, data["opening"], data["holding"], image)
