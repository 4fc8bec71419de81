"""When a body is at rest, and where: many measurements that agree are one place."""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Collection

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.planning.pose_geometry import distance_between, turn_between
from bt_jax.teaching.watch.sighting import Seen

__all__ = ["BodyTrack", "Rest", "WatchSettings"]

FINEST = 0.0003  # m, of a measurement: none counts more than one of this standard deviation
LEVER = 0.02  # m by which an error of position is one of angle
KEPT = 60  # measurements of a place that are averaged
LATELY = 30.0  # seconds for which measurements are kept


@dataclasses.dataclass(frozen=True)
class WatchSettings:
    """When what is seen counts. A body is at rest once at least `sightings` measurements over `settle` seconds agree within
    `still` [m] and `still_angle` [rad], beyond what their own standard deviations explain. Meanwhile nothing may cover it or
    what is within `near` of its own sizes; after `patience` [s] of rest, what still hides a part of it is no hand. It was
    bumped rather than carried if it moved by less than `carried` of its size, and not at all if by less than `bumped` and by
    less than `turned` [rad]. Nothing has moved any more after `idle` seconds."""

    settle: float = 0.6
    sightings: int = 3
    still: float = 0.003
    still_angle: float = 0.05
    near: float = 2.5
    patience: float = 3.0
    bumped: float = 0.12
    turned: float = 0.15
    carried: float = 0.5
    idle: float = 6.0


@dataclasses.dataclass(frozen=True)
class Rest:
    """Where a body was at rest, in the robot's base frame; `sigma` is the standard deviation of its position [m]. The mean
    of many images is not much better than one of them: most of the error is the same in all."""

    pose: RigidTransform
    sigma: float

    @staticmethod
    def of(measured: Collection[Seen]) -> Rest:
        """Return the mean of measurements, each weighted by the inverse of its variance."""
        weights = np.array([max(seen.sigma, FINEST) ** -2 for seen in measured])
        points = np.array([seen.pose.translation for seen in measured])
        mean = weights @ points / weights.sum()
        turns = Rotation.concatenate([seen.pose.rotation for seen in measured])
        scatter = float(np.sqrt(np.mean(np.sum((points - mean) ** 2, axis=1)) / len(points)))
        sigma = math.hypot(scatter, float(np.median([seen.sigma for seen in measured])))
        return Rest(RigidTransform.from_components(mean, turns.mean(weights)), sigma)


class BodyTrack:
    """What is known of one body over time: where it is at `rest`, if it is or was; whether it is `away` from there, first
    seen so at `left` [s]; and the measurements since."""

    def __init__(self, size: float, settings: WatchSettings) -> None:
        self.size, self.settings = size, settings
        self.rests: list[Rest] = []
        self.away, self.left = True, -math.inf
        self.seen = self.clear = -math.inf  # when it was last seen, and seen without anything that covers it
        self._resting: deque[Seen] = deque(maxlen=KEPT)
        self._recent: list[tuple[float, Seen]] = []
        self._elsewhere = 0

    @property
    def rest(self) -> Rest | None:
        """Where it was last at rest."""
        return self.rests[-1] if self.rests else None

    def see(self, time: float, seen: Seen) -> None:
        """Take in a measurement."""
        self.seen = time
        if not seen.covered:
            self.clear = time
        self._recent = [one for one in self._recent if time - one[0] <= LATELY]
        self._recent.append((time, seen))
        if self.away or self.rest is None:
            return
        if not self._moved(seen):
            self._elsewhere = 0
            if not seen.covered and self._agree(self.rest, seen):
                self._resting.append(seen)
            return
        self._elsewhere += 1
        if self._elsewhere == 1:
            self.left = time
        if self._elsewhere >= 2:
            self.average()
            self.away, self._recent = True, [one for one in self._recent if one[0] >= self.left]

    def candidate(self, time: float) -> tuple[Rest, float, bool] | None:
        """Return where it rests now, since when [s], and whether it was clear to see; None while it does not."""
        settings, chosen = self.settings, 0
        for chosen, (taken, _) in enumerate(reversed(self._recent), start=1):
            if chosen >= settings.sightings and time - taken >= settings.settle:
                break
        else:
            return None
        part = [seen for _, seen in self._recent[-chosen:]]
        clear = [seen for seen in part if not seen.covered]
        rest = Rest.of(clear or part)
        if not all(self._agree(rest, seen) for seen in part):
            return None
        since = time
        for taken, seen in reversed(self._recent):
            if not self._agree(rest, seen):
                break
            since = taken
        patient = time - since >= settings.patience
        return rest, since, patient or 3 * len(clear) >= 2 * len(part)

    def settle(self, rest: Rest) -> None:
        """Be at rest there."""
        self.rests.append(rest)
        self.away, self._elsewhere = False, 0
        self._resting = deque([seen for _, seen in self._recent if not seen.covered and self._agree(rest, seen)], KEPT)
        self._recent = self._recent[-1:]

    def average(self) -> None:
        """Replace the place at which it is at rest by the mean of what was measured there."""
        if self._resting and not self.away:
            self.rests[-1] = Rest.of(self._resting)

    def shift(self, rest: Rest) -> tuple[float, float]:
        """Return how far from its last place another one is: in its own sizes, and in rad."""
        assert self.rest is not None
        return distance_between(self.rest.pose, rest.pose) / self.size, turn_between(self.rest.pose, rest.pose)

    def _moved(self, seen: Seen) -> bool:
        """Does a measurement say that it is not where it was at rest? One that is covered in part must say so loudly."""
        assert self.rest is not None
        far = distance_between(self.rest.pose, seen.pose) - 2 * seen.sigma
        turned = turn_between(self.rest.pose, seen.pose) - 2 * seen.sigma / LEVER
        doubt = 2.5 if seen.covered else 1.0
        return far > doubt * self.settings.bumped * self.size or turned > doubt * self.settings.turned

    def _agree(self, rest: Rest, seen: Seen) -> bool:
        slack = 3 * seen.sigma
        far, turned = distance_between(rest.pose, seen.pose), turn_between(rest.pose, seen.pose)
        return far <= self.settings.still + slack and turned <= self.settings.still_angle + slack / LEVER
