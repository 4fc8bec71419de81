"""What is known of every body's place: measurements filtered, aged, and believed only when several agree."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.planning.pose_geometry import distance_between, turn_between

__all__ = ["Tracker", "TrackerSettings"]

SIGMA = 0.001  # m, of a measurement that says nothing about it
DOUBT = 2.0  # standard deviations by which a measurement worse than that may be further off
LEVER = 0.02  # m by which an error of position is one of angle


@dataclasses.dataclass(frozen=True)
class TrackerSettings:
    """`max_age` [s]: older knowledge is none. `frames`: as many images in a row must agree on a place before it is believed.
    Two measurements agree within `position` [m] and `angle` [rad], and within what `speed` [m/s] and `turn` [rad/s] allow
    between them unless that is longer than `unwatched` [s]: a body that was hidden and is elsewhere has jumped. `still` and
    `still_angle` say within what a body counts as resting, so that measurements are averaged, each weighted by the inverse
    of its variance; each makes those before it count less by a part in `window`."""

    max_age: float = 1.0
    frames: int = 3
    position: float = 0.006
    angle: float = 0.1
    speed: float = 0.5
    turn: float = 1.5
    unwatched: float = 0.25
    still: float = 0.003
    still_angle: float = 0.03
    window: int = 10


@dataclasses.dataclass
class _Track:
    pose: RigidTransform
    time: float
    weight: float  # of what was averaged: the sum of inverse variances, older ones forgotten [1/m2]
    count: int = 1


class Tracker:
    """Poses of bodies over time, all in one fixed frame. A measurement that contradicts what is known is a suspicion: the
    second one in a row withdraws the pose, and when `frames` of them agree the body has jumped there."""

    def __init__(self, settings: TrackerSettings | None = None) -> None:
        self.settings = settings or TrackerSettings()
        self._known: dict[str, _Track] = {}
        self._suspected: dict[str, _Track] = {}
        self._lock = threading.Lock()  # images come in one thread and are asked about in another

    def update(
        self, time: float, measured: Mapping[str, RigidTransform], sigmas: Mapping[str, float] = MappingProxyType({})
    ) -> None:
        """Take in what one image shows, taken at `time` [s]; what has passed already is ignored, and so is what is
        no number. `sigmas`: standard deviations of the positions [m]."""
        with self._lock:
            for name, pose in measured.items():
                sigma = sigmas.get(name, SIGMA)
                if sigma > 0 and np.isfinite([time, sigma, *pose.as_matrix().ravel()]).all():
                    self._take(name, time, pose, sigma)

    def poses(self, time: float) -> dict[str, RigidTransform]:
        """Return what is known and fresh at `time` [s]."""
        with self._lock:
            return {
                name: track.pose
                for name, track in self._known.items()
                if abs(time - track.time) <= self.settings.max_age and not self._doubted(name)
            }

    def last(self) -> dict[str, RigidTransform]:
        """Return where every body was when it was last known, however long ago: where to look for it first."""
        with self._lock:
            return {name: track.pose for name, track in self._known.items()}

    def times(self) -> dict[str, float]:
        """Return when every body was measured last [s], where it was known then."""
        with self._lock:
            return {name: track.time for name, track in self._known.items()}

    def _take(self, name: str, time: float, pose: RigidTransform, sigma: float) -> None:
        known = self._known.get(name)
        if known is not None and time <= known.time:
            return
        if known is not None and time - known.time <= self.settings.max_age and self._agree(known, time, pose):
            self._absorb(known, time, pose, sigma)
            self._suspected.pop(name, None)
        else:
            self._suspect(name, time, pose, sigma)

    def _suspect(self, name: str, time: float, pose: RigidTransform, sigma: float) -> None:
        suspected = self._suspected.get(name)
        if suspected is not None and time <= suspected.time:
            return
        recent = suspected is not None and time - suspected.time <= self.settings.max_age
        if suspected is not None and recent and self._agree(suspected, time, pose):
            self._absorb(suspected, time, pose, sigma)
        else:
            repeated = recent and name in self._known
            suspected = self._suspected[name] = _Track(pose, time, sigma**-2)
            if repeated:
                del self._known[name]
        if suspected.count >= self.settings.frames:
            self._known[name] = self._suspected.pop(name)

    def _doubted(self, name: str) -> bool:
        return name in self._suspected and self._suspected[name].count >= 2

    def _agree(self, track: _Track, time: float, pose: RigidTransform) -> bool:
        limits = self.settings
        gap = time - track.time
        passed = gap if gap <= limits.unwatched else 0.0
        return (
            distance_between(track.pose, pose) <= limits.position + limits.speed * passed
            and turn_between(track.pose, pose) <= limits.angle + limits.turn * passed
        )

    def _absorb(self, track: _Track, time: float, pose: RigidTransform, sigma: float) -> None:
        """Average if the body rests as far as this measurement can tell, else take the measurement."""
        limits, weight = self.settings, sigma**-2
        doubt = DOUBT * max(0.0, sigma - SIGMA)
        far, turned = distance_between(track.pose, pose), turn_between(track.pose, pose)
        still = far < min(limits.still + doubt, limits.position)
        still = still and turned < min(limits.still_angle + doubt / LEVER, limits.angle)
        before = track.weight * (1 - 1 / limits.window) if still else 0.0
        share = weight / (before + weight)
        turn = (pose.rotation * track.pose.rotation.inv()).as_rotvec()
        rotation = Rotation.from_rotvec(share * turn) * track.pose.rotation
        position = track.pose.translation + share * (pose.translation - track.pose.translation)
        track.pose = RigidTransform.from_components(position, rotation)
        track.time, track.weight = time, before + weight
        track.count += 1
