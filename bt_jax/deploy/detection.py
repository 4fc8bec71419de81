"""From an image to poses of boxes and kit in the camera's frame: ArUco markers, all that are seen of a body fused into one.

A pose starts from each marker alone (both solutions of a plane, IPPE), gathers the other markers that agree with it and is
refined on all their corners; the start with the most markers and then the least reprojection error wins. That pose tells
which other faces should be visible; it is refined on the image with all that are. One marker seen nearly head-on leaves two
poses possible: then the other one is reported too, and whoever knows more may choose.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.alignment import View, align, correlations
from bt_jax.deploy.markers import Marker, marker_dictionary, square

__all__ = ["Detection", "Detector", "Gates"]


@dataclasses.dataclass(frozen=True)
class Gates:
    """What is accepted. `marker`: root mean square reprojection error of one marker's corners as detected [px];
    `correlation`: of its pattern with the image; `facing`: sine of the least angle between view and surface; `sigma`:
    standard deviation of the position [m]; `ratio`: how much worse the second pose of a plane must fit for the first to be
    certain; `distinct`: rad between two poses that are two answers and not one."""

    marker: float = 2.0
    correlation: float = 0.85
    facing: float = 0.2
    sigma: float = 0.003
    ratio: float = 2.0
    distinct: float = 0.1


@dataclasses.dataclass(frozen=True)
class Detection:
    """A body as one image shows it. `pose` and `alternative` are the body's frame in the camera's (x right, y down, z
    forward) [m]; `alternative` is None where `pose` is certain. `error` is the root mean square reprojection error of the
    corners as detected [px], `sigma` the standard deviation of the position [m], `markers` the ids that agree."""

    body: str
    pose: RigidTransform
    alternative: RigidTransform | None
    error: float
    sigma: float
    markers: tuple[int, ...]


class Detector:
    """Finds the bodies that carry `markers`."""

    def __init__(self, markers: Sequence[Marker], gates: Gates | None = None) -> None:
        self.gates = gates or Gates()
        self._markers = {marker.id: marker for marker in markers}
        parameters = cv2.aruco.DetectorParameters()
        parameters.errorCorrectionRate = 0.0  # a marker read wrongly is worse than one not read
        parameters.minMarkerPerimeterRate = 0.05
        parameters.adaptiveThreshWinSizeStep = 4
        parameters.polygonalApproxAccuracyRate = 0.06  # of the perimeter: small markers have ragged edges
        parameters.perspectiveRemovePixelPerCell = 8
        parameters.perspectiveRemoveIgnoredMarginPerCell = 0.25
        self._aruco = cv2.aruco.ArucoDetector(marker_dictionary(), parameters)

    def __call__(self, image: np.ndarray, matrix: np.ndarray, distortion: np.ndarray) -> list[Detection]:
        """Bodies in an image u8[h, w, 3] (RGB) or u8[h, w]; `matrix` f[3, 3] and `distortion` f[n] as OpenCV has them.
        A body is absent where none of its markers is seen or its pose fails a gate."""
        gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
        if np.any(distortion):
            gray = cv2.undistort(gray, matrix, distortion)
        view = View(gray.astype(np.float32), matrix)
        bodies: dict[str, dict[int, np.ndarray]] = {}
        for number, corners in self._corners(gray).items():
            bodies.setdefault(self._markers[number].body, {})[number] = corners
        fits = (self._locate(body, seen, view) for body, seen in bodies.items())
        return [detection for detection in fits if detection is not None]

    def _corners(self, gray: np.ndarray) -> dict[int, np.ndarray]:
        """Corners f64[4, 2] [px] of the markers seen, by id. An id seen twice is no one's."""
        quads, ids, _ = self._aruco.detectMarkers(gray)
        numbers = [] if ids is None else np.ravel(ids).tolist()
        return {
            number: np.asarray(quad, float).reshape(4, 2)
            for number, quad in zip(numbers, quads, strict=True)
            if number in self._markers and numbers.count(number) == 1
        }

    def _locate(self, body: str, seen: dict[int, np.ndarray], view: View) -> Detection | None:
        starts = [self._gathered(start, seen, view) for start in self._starts(seen, view)]
        starts = sorted((start for start in starts if start), key=lambda start: (-len(start.markers), start.error))
        rivals = _distinct(starts, self.gates.distinct)[:2]
        rivals = [rival for rival in rivals if len(rival.markers) == len(rivals[0].markers)]
        fits = [fit for start in rivals if (fit := self._refined(body, start.pose, seen, view))]
        fits = _distinct(sorted(fits, key=lambda fit: (-len(fit.markers), fit.residual)), self.gates.distinct)
        if not fits or fits[0].sigma > self.gates.sigma:
            return None
        best, *others = fits
        ambiguous = [
            fit
            for fit in others
            if len(fit.markers) == len(best.markers) and fit.residual < self.gates.ratio * best.residual
        ]
        alternative = ambiguous[0].pose if ambiguous else None
        return Detection(body, best.pose, alternative, best.error, best.sigma, best.markers)

    def _starts(self, seen: dict[int, np.ndarray], view: View) -> Iterator[RigidTransform]:
        for number, corners in seen.items():
            marker = self._markers[number]
            found, rotations, positions, _ = cv2.solvePnPGeneric(
                square(marker.size), corners, view.matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
            )
            for rotation, position in zip(rotations[:found], positions[:found], strict=True):
                if not (np.all(np.isfinite(rotation)) and np.all(np.isfinite(position))):
                    continue  # OpenCV finds no numbers for some flat views
                yield _pose(rotation, position) * marker.pose.inv()

    def _gathered(self, start: RigidTransform, seen: dict[int, np.ndarray], view: View) -> _Fit | None:
        """The pose refined on the corners of all markers that agree with it."""
        agreeing = [number for number in seen if self._misfit(start, number, seen, view) < 4 * self.gates.marker]
        if not agreeing:
            return None
        points = np.concatenate([self._markers[number].corners for number in agreeing])
        pixels = np.concatenate([seen[number] for number in agreeing])
        pose = _pose(
            *cv2.solvePnPRefineLM(
                points,
                pixels,
                view.matrix,
                None,
                start.rotation.as_rotvec(),
                np.array(start.translation),
            )
        )
        agreeing = [number for number in seen if self._misfit(pose, number, seen, view) < self.gates.marker]
        return self._fit(pose, agreeing, seen, view) if agreeing else None

    def _refined(self, body: str, pose: RigidTransform, seen: dict[int, np.ndarray], view: View) -> _Fit | None:
        """The pose refined on the image with every face that should be and is visible."""
        facing = [marker for marker in self._markers.values() if marker.body == body and self._faces(pose, marker)]
        visible = self._correlating(pose, facing, view, self.gates.correlation - 0.25)
        if not visible:
            return None
        pose = align(view, pose, visible).pose
        visible = self._correlating(pose, facing, view, self.gates.correlation)
        agreeing = [m.id for m in visible if m.id in seen and self._misfit(pose, m.id, seen, view) < self.gates.marker]
        if not agreeing:
            return None
        alignment = align(view, pose, visible)
        fit = self._fit(alignment.pose, agreeing, seen, view)
        numbers = tuple(marker.id for marker in visible)
        return dataclasses.replace(fit, residual=alignment.residual, sigma=alignment.sigma, markers=numbers)

    def _correlating(self, pose: RigidTransform, markers: list[Marker], view: View, least: float) -> list[Marker]:
        if not markers:
            return []
        values = correlations(view, pose, markers)
        return [marker for marker, value in zip(markers, values, strict=True) if value > least]

    def _faces(self, pose: RigidTransform, marker: Marker) -> bool:
        """Does the camera look at the marker's front, and not too flatly?"""
        face = pose * marker.pose
        outward, position = face.rotation.as_matrix()[:, 2], face.translation
        return bool(position[2] > 0 and -outward @ position > self.gates.facing * np.linalg.norm(position))

    def _misfit(self, pose: RigidTransform, number: int, seen: dict[int, np.ndarray], view: View) -> float:
        marker = self._markers[number]
        if not self._faces(pose, marker):
            return float("inf")
        return _rms(view.project(pose, marker.corners) - seen[number])

    def _fit(self, pose: RigidTransform, numbers: list[int], seen: dict[int, np.ndarray], view: View) -> _Fit:
        points = np.concatenate([self._markers[number].corners for number in numbers])
        pixels = np.concatenate([seen[number] for number in numbers])
        error = _rms(view.project(pose, points) - pixels)
        return _Fit(pose, error, tuple(numbers))


@dataclasses.dataclass(frozen=True)
class _Fit:
    pose: RigidTransform
    error: float
    markers: tuple[int, ...]
    residual: float = 0.0
    sigma: float = 0.0


def _distinct(fits: list[_Fit], angle: float) -> list[_Fit]:
    """Without those that a better one is the same answer as."""
    kept: list[_Fit] = []
    for fit in fits:
        if all((fit.pose.rotation.inv() * other.pose.rotation).magnitude() > angle for other in kept):
            kept.append(fit)
    return kept


def _pose(rotation: np.ndarray, position: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(np.ravel(position), Rotation.from_rotvec(np.ravel(rotation)))


def _rms(residuals: np.ndarray) -> float:
    """Root mean square distance, px."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1))))
