"""From an image to poses of boxes and kit in the camera's frame: ArUco markers, all that are seen of a body fused into one.

A pose starts from each marker alone (both solutions of a plane, IPPE), gathers the other markers that agree with it and is
refined on all their corners; the start with the most markers and then the least reprojection error wins. That pose tells
which other faces should be visible; it is refined on the image with all that are. One marker seen nearly head-on leaves two
poses possible: then the other one is reported too, and whoever knows more may choose.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.alignment import SHARP, ImageSampler, align, bits_like, correlations
from bt_jax.deploy.perception.arrays import ColorImage, Corners, Distortion, GrayImage, Matrix3
from bt_jax.deploy.perception.markers import Marker, marker_dictionary, square
from bt_jax.deploy.perception.prints import metric
from bt_jax.deploy.perception.sharpness import edge_blur
from bt_jax.deploy.robot.arrays import Point

__all__ = ["Detection", "Detector", "Gates", "Picture"]

RIVALS = 3  # other answers that the image is asked about where no two markers agree
DOUBT = 3.0  # how much worse the corners may fit a second pose for the image to be asked

NUDGE = np.array([[0.013, -0.007], [-0.005, 0.011], [0.009, 0.017], [-0.019, 0.003]])
"""Pixels added to corners: OpenCV's closed form divides by zero where a square is seen as an exact trapezium, as one that
stands square to the camera is. Only starts depend on it."""

UNMISTAKABLE = 0.35  # sine of the angle between view and surface from which on a marker that is there is recognised
WHITE = 252  # brightness from which on a pixel is as bright as can be
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
class Detection:
    """A body as one image shows it. `pose` and `alternative` are the body's frame in the camera's (x right, y down, z
    forward) [m]; `alternative` is None where `pose` is certain. `error` is the root mean square reprojection error of the
    corners as detected [px], `sigma` the standard deviation of the position [m], `markers` the ids that agree. `blur` is the
    standard deviation of the lens's blur there, `module` the length of one of the markers' modules, both in px. `unlike` are
    the markers that face the camera, and where the image shows something else: they are hidden."""

    body: str
    pose: RigidTransform
    alternative: RigidTransform | None
    error: float
    sigma: float
    markers: tuple[int, ...]
    blur: float
    module: float
    unlike: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True)
class Picture:
    """What one image shows. `repeated`: markers that are seen more than once, whose bodies are therefore not detected;
    `apart`: bodies with markers at places that contradict each other. `blur` is that of the image's edges, told where
    nothing is detected, `focal` the focal length, both in px. `washed_out` is the share of the
    picture that is as bright as can be, `brightest` the brightness that 99 of 100 pixels stay below, of 255."""

    detections: tuple[Detection, ...]
    repeated: tuple[int, ...] = ()
    apart: tuple[str, ...] = ()
    blur: float = math.nan
    focal: float = math.nan
    washed_out: float = 0.0
    brightest: float = 255.0


class Detector:
    """Find the bodies that carry `markers`."""

    def __init__(self, markers: Sequence[Marker], gates: Gates | None = None) -> None:
        self.gates = gates or Gates()
        self._markers = {marker.id: marker for marker in markers}
        self._bodies: dict[str, list[Marker]] = {}
        for marker in markers:
            self._bodies.setdefault(marker.body, []).append(marker)
        parameters = cv2.aruco.DetectorParameters()
        parameters.errorCorrectionRate = 0.0  # a marker read wrongly is worse than one not read
        parameters.minMarkerPerimeterRate = 0.05
        parameters.adaptiveThreshWinSizeStep = 4
        parameters.polygonalApproxAccuracyRate = 0.06  # of the perimeter: small markers have ragged edges
        parameters.perspectiveRemovePixelPerCell = 8
        parameters.perspectiveRemoveIgnoredMarginPerCell = 0.25
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR  # approximated polygons lose corners
        self._aruco = cv2.aruco.ArucoDetector(marker_dictionary(), parameters)

    def __call__(
        self,
        image: ColorImage | GrayImage,
        matrix: Matrix3,
        distortion: Distortion,
        known: Mapping[str, RigidTransform] = MappingProxyType({}),
    ) -> list[Detection]:
        """Return the bodies that an image shows, see `look`."""
        return list(self.look(image, matrix, distortion, known).detections)

    def look(
        self,
        image: ColorImage | GrayImage,
        matrix: Matrix3,
        distortion: Distortion,
        known: Mapping[str, RigidTransform] = MappingProxyType({}),
    ) -> Picture:
        """Return what an image shows. A body is absent if none of its markers is seen or its pose fails a gate. What is
        `known`, by body and in the camera's frame, is looked for there first: a marker covered in part can confirm it,
        though none could be read."""
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if np.any(distortion):
            gray = cv2.undistort(gray, matrix, distortion)
        view = ImageSampler(gray.astype(np.float32), matrix)
        bodies: dict[str, Seen] = {body: {} for body in known}
        repeated = []
        for number, quads in self._read(gray).items():
            if len(quads) > 1:
                repeated.append(number)
            else:
                bodies.setdefault(self._markers[number].body, {})[number] = quads[0]
        doubled = {self._markers[number].body for number in repeated}
        detections, apart = [], []
        for body, seen in bodies.items():
            if body in doubled:
                continue
            detection = self._confirm(body, seen, view, known) or self._locate(body, seen, view)
            elsewhere = () if detection is None else self._elsewhere(detection, seen, view)
            if elsewhere:
                apart.append(body)
            if detection is not None and not (elsewhere and 2 * len(elsewhere) >= len(seen)):
                detections.append(detection)
        blur = math.nan if detections or doubled else edge_blur(gray)
        sample = gray[::4, ::4]
        return Picture(
            tuple(detections),
            tuple(repeated),
            tuple(apart),
            blur,
            float(view.focal.mean()),
            washed_out=float((sample >= WHITE).mean()),
            brightest=float(np.percentile(sample, 99)),
        )

    def _read(self, gray: GrayImage) -> dict[int, list[Corners]]:
        """Return every marker of the bodies that is read, at each of its places; contours in one another are one place."""
        found, ids, _ = self._aruco.detectMarkers(gray)
        places: dict[int, list[Corners]] = {}
        for number, quad in zip([] if ids is None else np.ravel(ids), found, strict=True):
            if int(number) not in self._markers:
                continue
            corners = np.asarray(quad, float).reshape(4, 2)
            others = places.setdefault(int(number), [])
            if all(np.linalg.norm((other - corners).mean(axis=0)) > _side(corners) / 2 for other in others):
                others.append(corners)
        return places

    def _elsewhere(self, detection: Detection, seen: Seen, view: ImageSampler) -> tuple[int, ...]:
        """Return the markers that are read further than their own size from where the body's pose has them, or though the
        pose has them face away."""
        fit = _Fit(detection.pose.rotation.as_matrix(), detection.pose.translation)
        return tuple(
            number
            for number, corners in seen.items()
            if not self._faces(fit, self._markers[number], -self.gates.facing)
            or not self._error(fit, [number], seen, view) <= max(_side(corners), 4 * self.gates.marker)
        )

    def _confirm(
        self, body: str, seen: Seen, view: ImageSampler, known: Mapping[str, RigidTransform]
    ) -> Detection | None:
        """Return the body where it is known to be, if the image agrees and no marker read elsewhere contradicts it."""
        if body not in known:
            return None
        start = _Fit(known[body].rotation.as_matrix(), known[body].translation)
        facing = [marker for marker in self._bodies[body] if self._faces(start, marker)]
        visible = self._correlating(start, facing, view, self.gates.correlation)
        near = bool(visible)
        visible = visible or self._correlating(start, facing, view, self.gates.confirmation - 0.25)
        if not visible:
            return None
        alignment = align(view, start.rotation, start.position, visible, near=near)
        fit = _Fit(alignment.rotation, alignment.position)
        kept = self._correlating(fit, facing, view, self.gates.confirmation, alignment.blur)
        if not kept or set(seen) - set(self._agreeing(fit, seen, view, self.gates.marker)):
            return None
        if kept != visible:
            alignment = align(view, fit.rotation, fit.position, kept, near=True)
            fit = _Fit(alignment.rotation, alignment.position)
        moved = math.dist(fit.position, start.position)
        turned = _angle(fit, start)
        if not (moved <= self.gates.near and turned <= self.gates.distinct and alignment.sigma <= self.gates.sigma):
            return None
        error = self._error(fit, list(seen), seen, view) if seen else 0.0
        module = self._module(fit, kept, view)
        numbers = tuple(marker.id for marker in kept)
        unlike = self._unlike(fit, view, body, alignment.blur)
        return Detection(body, fit.pose, None, error, alignment.sigma, numbers, alignment.blur, module, unlike)

    def _locate(self, body: str, seen: Seen, view: ImageSampler) -> Detection | None:
        rivals = self._by_corners(seen, view)
        fits = [fit for rival in rivals if (fit := self._by_image(body, rival, seen, view))]
        fits.sort(key=lambda fit: (-len(fit.markers), fit.residual))
        if not fits or not fits[0].sigma <= self.gates.sigma:
            return None
        best, alternative = fits[0], None
        for fit in fits[1:]:
            as_good = len(fit.markers) == len(best.markers) and fit.residual < self.gates.ratio * best.residual
            if as_good and not _angle(fit, best) <= self.gates.distinct:
                alternative = fit.pose
        module = self._module(best, [self._markers[number] for number in best.markers], view)
        unlike = self._unlike(best, view, body, best.blur)
        return Detection(body, best.pose, alternative, best.error, best.sigma, best.markers, best.blur, module, unlike)

    def _unlike(self, fit: _Fit, view: ImageSampler, body: str, blur: float) -> tuple[int, ...]:
        """Return the markers in the image that should be seen well and are not at all like what is there."""
        facing = [marker for marker in self._bodies[body] if self._faces(fit, marker, UNMISTAKABLE)]
        likes = bits_like(view, fit.rotation, fit.position, facing, blur)
        return tuple(marker.id for marker, like in zip(facing, likes, strict=True) if like < self.gates.unlike)

    def _module(self, fit: _Fit, markers: Sequence[Marker], view: ImageSampler) -> float:
        """Return the mean length of a module of the `markers` in the image, px."""
        spreads = [metric(view.focal, fit.rotation, fit.position, marker) for marker in markers]
        return float(np.mean(np.linalg.det(spreads) ** -0.25))

    def _by_corners(self, seen: Seen, view: ImageSampler) -> list[_Fit]:
        """Return the pose that most markers agree with, and others if the corners leave a doubt."""
        fits: list[_Fit] = []
        for start in self._starts(seen, view):
            agreeing = self._agreeing(start, seen, view, 4 * self.gates.marker)
            known = [fit for fit in fits if _angle(fit, start) < self.gates.distinct]
            if not agreeing or any(set(agreeing) <= set(fit.markers) for fit in known):
                continue
            if len(agreeing) > 1:
                points = np.concatenate([self._markers[number].corners for number in agreeing])
                pixels = np.concatenate([seen[number] for number in agreeing])
                turn = cv2.Rodrigues(start.rotation)[0]
                turn, position = cv2.solvePnPRefineLM(
                    points, pixels, view.matrix, None, turn, start.position[:, None].copy()
                )
                start = _Fit(cv2.Rodrigues(turn)[0], np.ravel(position))
                agreeing = self._agreeing(start, seen, view, self.gates.marker)
            if agreeing:
                error = self._error(start, agreeing, seen, view)
                fits.append(dataclasses.replace(start, error=error, markers=tuple(agreeing)))
        fits.sort(key=lambda fit: (-len(fit.markers), fit.error))
        one = bool(fits) and len(fits[0].markers) == 1  # then both answers of its plane
        limit = math.inf if one or not fits else DOUBT * fits[0].error + self.gates.marker / 2
        others = [
            fit
            for fit in fits[1:]
            if len(fit.markers) == len(fits[0].markers)
            and fit.error < limit
            and _angle(fit, fits[0]) > self.gates.distinct
        ]
        return fits[:1] + others[: RIVALS if one else 1]

    def _starts(self, seen: Seen, view: ImageSampler) -> Iterator[_Fit]:
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
                yield _Fit(rotation, np.ravel(position) - rotation @ marker.pose.translation)

    def _by_image(self, body: str, start: _Fit, seen: Seen, view: ImageSampler) -> _Fit | None:
        """Return the pose refined on the image with every face that should be visible and is."""
        facing = [marker for marker in self._bodies[body] if self._faces(start, marker)]
        visible = self._correlating(start, facing, view, self.gates.correlation - 0.25)
        if not visible:
            return None
        alignment = align(view, start.rotation, start.position, visible)
        fit = _Fit(alignment.rotation, alignment.position)
        kept = self._correlating(fit, facing, view, self.gates.correlation, alignment.blur)
        agreeing = self._agreeing(fit, {m.id: seen[m.id] for m in kept if m.id in seen}, view, self.gates.marker)
        if not agreeing:
            return None
        if kept != visible:
            alignment = align(view, fit.rotation, fit.position, kept, near=True)
            fit = _Fit(alignment.rotation, alignment.position)
        return dataclasses.replace(
            fit,
            error=self._error(fit, agreeing, seen, view),
            markers=tuple(marker.id for marker in kept),
            residual=alignment.residual,
            sigma=alignment.sigma,
            blur=alignment.blur,
        )

    def _correlating(
        self, fit: _Fit, markers: list[Marker], view: ImageSampler, least: float, blur: float = SHARP
    ) -> list[Marker]:
        if not markers:
            return []
        own, others = correlations(view, fit.rotation, fit.position, markers, tuple(self._markers), blur)
        clear = own > np.maximum(least, others + self.gates.margin)
        return [marker for marker, kept in zip(markers, clear, strict=True) if kept]

    def _faces(self, fit: _Fit, marker: Marker, least: float | None = None) -> bool:
        """Does the camera look at the marker's front, and not too flatly: with a sine of `least`, else of the gate?"""
        least = self.gates.facing if least is None else least
        position = fit.rotation @ marker.pose.translation + fit.position
        outward = fit.rotation @ marker.axes[:, 2]
        return bool(position[2] > 0 and -outward @ position > least * math.sqrt(position @ position))

    def _agreeing(self, fit: _Fit, seen: Seen, view: ImageSampler, limit: float) -> list[int]:
        """Return the markers that appear within `limit` pixels of where the pose has them."""
        return [
            number
            for number in seen
            if self._faces(fit, self._markers[number]) and self._error(fit, [number], seen, view) < limit
        ]

    def _error(self, fit: _Fit, numbers: Sequence[int], seen: Seen, view: ImageSampler) -> float:
        """Return the root mean square distance of the corners as detected from where the pose has them, px."""
        points = np.concatenate([self._markers[number].corners for number in numbers])
        pixels = np.concatenate([seen[number] for number in numbers])
        offsets = view.project(points @ fit.rotation.T + fit.position) - pixels
        return math.sqrt(float(np.mean(offsets**2)) * 2)


@dataclasses.dataclass(frozen=True)
class _Fit:
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


def _side(corners: Corners) -> float:
    """Return the mean edge of a quad, px."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())


def _angle(a: _Fit, b: _Fit) -> float:
    """Return the angle between two rotations, rad."""
    return math.acos(max(-1.0, min(1.0, (float(np.sum(a.rotation * b.rotation)) - 1) / 2)))
