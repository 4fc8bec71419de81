"""What the robot knows at one moment: the only thing that conditions and skills look at."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any

from scipy.spatial.transform import RigidTransform, Rotation

__all__ = ["Finding", "Observation", "pose_from_list", "pose_to_list"]


@dataclasses.dataclass(frozen=True)
class Finding:
    """Something in the picture that is not as it should be. `about` is a box or the kit, "" for the picture as a
    whole; `text` a clause that says it, such as "GreenBox's marker is seen twice". `stops`: what is
    known is wrong while it lasts, and a run must not go on. `sight`: the camera's place and the places that it does not
    see and should [m, base frame]; an arm between them explains it. `missing`: `about` is not where it was seen last."""

    about: str
    text: str
    stops: bool = False
    sight: tuple[tuple[float, float, float], ...] = ()
    missing: bool = False

    def __str__(self) -> str:
        return self.text


@dataclasses.dataclass(frozen=True)
class Observation:
    """The cell as it is known at `time` [s]. What is not in `poses` is unknown, and nothing may be taken for true of it."""

    time: float
    poses: Mapping[str, RigidTransform]  # of boxes and kit, in the robot's base frame [m]; fresh ones only
    opening: Mapping[str, float]  # of each arm's gripper: m between the fingers
    holding: str | None  # the box that is held
    image: float = math.inf  # time of the newest camera image, s
    lost: str = ""  # why there is no newer one; "" where that is not known
    findings: tuple[Finding, ...] = ()  # what is wrong with what the picture shows
    measured: Mapping[str, float] = dataclasses.field(default_factory=dict)  # object -> when last, s

    @property
    def missing(self) -> frozenset[str]:
        """What is no longer where it was seen last, though nothing known hides that place."""
        return frozenset(finding.about for finding in self.findings if finding.missing)

    def to_dict(self) -> dict[str, Any]:
        """Return it as the log has it, see `pose_to_list`."""
        image = None if math.isinf(self.image) else self.image
        return {
            "time": self.time,
            "poses": {name: pose_to_list(pose) for name, pose in self.poses.items()},
            "opening": dict(self.opening),
            "holding": self.holding,
            "image": image,
            "findings": [[f.about, f.text, f.stops, f.missing] for f in self.findings],
            "measured": dict(self.measured),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> Observation:
        """Read what `to_dict` returns, or did before there were findings."""
        poses = {name: pose_from_list(values) for name, values in data["poses"].items()}
        image = math.inf if data["image"] is None else data["image"]
        findings = tuple(
            Finding(about, text, stops, missing=missing == [True])
            for about, text, stops, *missing in data.get("findings", ())
        )
        return Observation(
            data["time"],
            poses,
            data["opening"],
            data["holding"],
            image,
            findings=findings,
            measured=data.get("measured", {}),
        )


def pose_to_list(pose: RigidTransform) -> list[float]:
    """Return a pose as the file format of logs has it: position [m] and quaternion xyzw."""
    return [*pose.translation.tolist(), *pose.rotation.as_quat().tolist()]


def pose_from_list(values: Sequence[float]) -> RigidTransform:
    """Read what `pose_to_list` returns."""
    return RigidTransform.from_components(values[:3], Rotation.from_quat(values[3:]))
