"""Poses of a body that carries markers, from their corners and then from the image itself.

A pose starts from each marker alone (both solutions of a plane, IPPE), gathers the other markers that agree with it and is
refined on all their corners. That pose tells which other faces should be visible; it is refined on the image with all that
are.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.alignment import SHARP, ImageSampler, align, bits_like, correlations
from bt_jax.deploy.perception.arrays import Corners, Matrix3
from bt_jax.deploy.perception.markers import Marker, square
from bt_jax.deploy.perception.prints import metric
from bt_jax.deploy.planning.pose_geometry import turn_between
from bt_jax.deploy.robot.arrays import Point

__all__ = ["Fit", "Gates", "PoseFitter", "Seen"]

RIVALS = 3  # other answers that the image is asked about where no two markers agree
DOUBT = 3.0  # how much worse the corners may fit a second pose for the image to be asked

NUDGE = np.array([[0.013, -0.007], [-0.005, 0.011], [0.009, 0.017], [-0.019, 0.003]])
"""Pixels added to corners: OpenCV's closed form divides by zero where a square is seen as an exact trapezium, as one that
stands square to the camera is. Only starts depend on it."""

UNMISTAKABLE = 0.35  # sine of the angle between view and surface from which on a marker that is there is recognised
Seen = dict[int, Corners]
"""The corners of markers by their ids."""


@dataclasses.dataclass(frozen=True)
class Gates:
    """What is accepted. `marker`: root mean square reprojection error of one marker's corners as detected [px];
    `correlation`: of its pattern with the image, or `confirmation` where the body was known to be within `near` [m]; below
    `unlike`, its bits are hidden;
    `margin`: by how much every other marker's pattern must correlate less; `facing`: sine of the least angle between view
    and surface; `sigma`: standard deviation of the position [m]; `ratio`: how much worse the second pose of a plane must
    fit for the first to be certain; `distinct`: rad between two poses that are two answers and not one."""

    marker: float = 2.0
    correlation: float = 0.85
    confirmation: float = 0.7
    unlike: float = 0.6
    near: float = 0.006
    margin: float = 0.05
    facing: float = 0.2
    sigma: float = 0.003
    ratio: float = 1.6
    distinct: float = 0.1


@dataclasses.dataclass(frozen=True)
class Fit:
    """A pose under way, of a body in the camera's frame, and what speaks for it."""

    rotation: Matrix3
    position: Point
    error: float = math.inf
    markers: tuple[int, ...] = ()
    residual: float = math.inf
    sigma: float = math.inf
    blur: float = SHARP

    @property
    def pose(self) -> RigidTransform:
        return RigidTransform.from_components(self.position, Rotation.from_matrix(self.rotation))


class PoseFitter:
    """Fit poses of the bodies that carry `markers`."""

    def __init__(self, markers: Sequence[Marker], gates: Gates) -> None:
        self.gates = gates
        self._markers = {marker.id: marker for marker in markers}
        self._bodies: dict[str, list[Marker]] = {}
        for marker in markers:
            self._bodies.setdefault(marker.body, []).append(marker)

    def unlike(self, fit: Fit, view: ImageSampler, body: str, blur: float) -> tuple[int, ...]:
        """Return the markers in the image that should be seen well and are not at all like what is there."""
        facing = [marker for marker in self._bodies[body] if self.faces(fit, marker, UNMISTAKABLE)]
        likes = bits_like(view, fit.rotation, fit.position, facing, blur)
        return tuple(marker.id for marker, like in zip(facing, likes, strict=True) if like < self.gates.unlike)

    def module(self, fit: Fit, markers: Sequence[Marker], view: ImageSampler) -> float:
        """Return the mean length of a module of the `markers` in the image, px."""
        spreads = [metric(view.focal, fit.rotation, fit.position, marker) for marker in markers]
        return float(np.mean(np.linalg.det(spreads) ** -0.25))

    def by_corners(self, seen: Seen, view: ImageSampler) -> list[Fit]:
        """Return the pose that most markers agree with, and others if the corners leave a doubt."""
        fits: list[Fit] = []
        for start in self._starts(seen, view):
            agreeing = self.agreeing(start, seen, view, 4 * self.gates.marker)
            known = [fit for fit in fits if turn_between(fit.pose, start.pose) < self.gates.distinct]
            if not agreeing or any(set(agreeing) <= set(fit.markers) for fit in known):
                continue
            if len(agreeing) > 1:
                points = np.concatenate([self._markers[number].corners for number in agreeing])
                pixels = np.concatenate([seen[number] for number in agreeing])
                turn = cv2.Rodrigues(start.rotation)[0]
                turn, position = cv2.solvePnPRefineLM(
                    points, pixels, view.matrix, None, turn, start.position[:, None].copy()
                )
                start = Fit(cv2.Rodrigues(turn)[0], np.ravel(position))
                agreeing = self.agreeing(start, seen, view, self.gates.marker)
            if agreeing:
                error = self.error(start, agreeing, seen, view)
                fits.append(dataclasses.replace(start, error=error, markers=tuple(agreeing)))
        fits.sort(key=lambda fit: (-len(fit.markers), fit.error))
        one = bool(fits) and len(fits[0].markers) == 1  # then both answers of its plane
        limit = math.inf if one or not fits else DOUBT * fits[0].error + self.gates.marker / 2
        others = [
            fit
            for fit in fits[1:]
            if len(fit.markers) == len(fits[0].markers)
            and fit.error < limit
            and turn_between(fit.pose, fits[0].pose) > self.gates.distinct
        ]
        return fits[:1] + others[: RIVALS if one else 1]

    def _starts(self, seen: Seen, view: ImageSampler) -> Iterator[Fit]:
        for number, corners in seen.items():
            marker = self._markers[number]
            nudged = corners + NUDGE
            found, rotations, positions, _ = cv2.solvePnPGeneric(
                square(marker.size), nudged, view.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            for turn, position in zip(rotations[:found], positions[:found], strict=True):
                if not (np.isfinite(turn).all() and np.isfinite(position).all()):  # a quad that no square gives
                    continue
                rotation = cv2.Rodrigues(turn)[0] @ marker.axes.T
                yield Fit(rotation, np.ravel(position) - rotation @ marker.pose.translation)

    def by_image(self, body: str, start: Fit, seen: Seen, view: ImageSampler) -> Fit | None:
        """Return the pose refined on the image with every face that should be visible and is."""
        facing = [marker for marker in self._bodies[body] if self.faces(start, marker)]
        visible = self.correlating(start, facing, view, self.gates.correlation - 0.25)
        if not visible:
            return None
        alignment = align(view, start.rotation, start.position, visible)
        fit = Fit(alignment.rotation, alignment.position)
        kept = self.correlating(fit, facing, view, self.gates.correlation, alignment.blur)
        agreeing = self.agreeing(fit, {m.id: seen[m.id] for m in kept if m.id in seen}, view, self.gates.marker)
        if not agreeing:
            return None
        if kept != visible:
            alignment = align(view, fit.rotation, fit.position, kept, near=True)
            fit = Fit(alignment.rotation, alignment.position)
        return dataclasses.replace(
            fit,
            error=self.error(fit, agreeing, seen, view),
            markers=tuple(marker.id for marker in kept),
            residual=alignment.residual,
            sigma=alignment.sigma,
            blur=alignment.blur,
        )

    def correlating(
        self, fit: Fit, markers: list[Marker], view: ImageSampler, least: float, blur: float = SHARP
    ) -> list[Marker]:
        """Return the markers that look as they should where the pose has them, and like no other."""
        if not markers:
            return []
        own, others = correlations(view, fit.rotation, fit.position, markers, tuple(self._markers), blur)
        clear = own > np.maximum(least, others + self.gates.margin)
        return [marker for marker, kept in zip(markers, clear, strict=True) if kept]

    def faces(self, fit: Fit, marker: Marker, least: float | None = None) -> bool:
        """Does the camera look at the marker's front, and not too flatly: with a sine of `least`, else of the gate?"""
        least = self.gates.facing if least is None else least
        position = fit.rotation @ marker.pose.translation + fit.position
        outward = fit.rotation @ marker.axes[:, 2]
        return bool(position[2] > 0 and -outward @ position > least * math.sqrt(position @ position))

    def agreeing(self, fit: Fit, seen: Seen, view: ImageSampler, limit: float) -> list[int]:
        """Return the markers that appear within `limit` pixels of where the pose has them."""
        return [
            number
            for number in seen
            if self.faces(fit, self._markers[number]) and self.error(fit, [number], seen, view) < limit
        ]

    def error(self, fit: Fit, numbers: Sequence[int], seen: Seen, view: ImageSampler) -> float:
        """Return the root mean square distance of the corners as detected from where the pose has them, px."""
        points = np.concatenate([self._markers[number].corners for number in numbers])
        pixels = np.concatenate([seen[number] for number in numbers])
        offsets = view.project(points @ fit.rotation.T + fit.position) - pixels
        return math.sqrt(float(np.mean(offsets**2)) * 2)
