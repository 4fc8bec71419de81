"""From an image to poses of objects and kits in the camera's frame: ArUco markers, all those of a body fused into one.

Of the poses that fit, the one with the most markers and then the least error wins. One marker seen nearly head-on leaves two
poses possible: then the other one is reported too, and whoever knows more may choose.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.alignment import ImageSampler, align
from bt_jax.deploy.perception.arrays import ColorImage, Corners, Distortion, GrayImage, Matrix3
from bt_jax.deploy.perception.markers import Marker, marker_dictionary
from bt_jax.deploy.perception.pose_fit import Fit, Gates, PoseFitter, Seen
from bt_jax.deploy.perception.sharpness import edge_blur
from bt_jax.deploy.planning.pose_geometry import turn_between

__all__ = ["Detection", "Detector", "Picture"]

WHITE = 252  # brightness from which on a pixel is as bright as can be


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
        self._fitter = PoseFitter(markers, self.gates)
        self._markers = {marker.id: marker for marker in markers}
        self._bodies: dict[str, list[Marker]] = {}
        for marker in markers:
            self._bodies.setdefault(marker.body, []).append(marker)
        parameters = cv2.aruco.DetectorParameters()
        parameters.errorCorrectionRate = 0.0  # a marker read wrongly is worse than one not read
        parameters.maxErroneousBitsInBorderRate = 0.2  # else the edge of the sticker is read as that of the marker
        parameters.minMarkerPerimeterRate = 0.05
        parameters.adaptiveThreshWinSizeStep = 4
        parameters.polygonalApproxAccuracyRate = 0.06  # of the perimeter: small markers have ragged edges
        parameters.perspectiveRemovePixelPerCell = 8
        parameters.perspectiveRemoveIgnoredMarginPerCell = 0.25
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR  # approximated polygons lose corners
        self._aruco = cv2.aruco.ArucoDetector(marker_dictionary(1 + max(self._markers)), parameters)

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
        fit = Fit(detection.pose.rotation.as_matrix(), detection.pose.translation)
        return tuple(
            number
            for number, corners in seen.items()
            if not self._fitter.faces(fit, self._markers[number], -self.gates.facing)
            or not self._fitter.error(fit, [number], seen, view) <= max(_side(corners), 4 * self.gates.marker)
        )

    def _confirm(
        self, body: str, seen: Seen, view: ImageSampler, known: Mapping[str, RigidTransform]
    ) -> Detection | None:
        """Return the body where it is known to be, if the image agrees and no marker read elsewhere contradicts it."""
        if body not in known:
            return None
        start = Fit(known[body].rotation.as_matrix(), known[body].translation)
        facing = [marker for marker in self._bodies[body] if self._fitter.faces(start, marker)]
        visible = self._fitter.correlating(start, facing, view, self.gates.correlation)
        near = bool(visible)
        visible = visible or self._fitter.correlating(start, facing, view, self.gates.confirmation - 0.25)
        if not visible:
            return None
        alignment = align(view, start.rotation, start.position, visible, near=near)
        fit = Fit(alignment.rotation, alignment.position)
        kept = self._fitter.correlating(fit, facing, view, self.gates.confirmation, alignment.blur)
        if not kept or set(seen) - set(self._fitter.agreeing(fit, seen, view, self.gates.marker)):
            return None
        if kept != visible:
            alignment = align(view, fit.rotation, fit.position, kept, near=True)
            fit = Fit(alignment.rotation, alignment.position)
        moved = math.dist(fit.position, start.position)
        if not (moved <= self.gates.near and alignment.sigma <= self.gates.sigma):
            return None
        if turn_between(fit.pose, start.pose) > self.gates.distinct:
            return None
        error = self._fitter.error(fit, list(seen), seen, view) if seen else 0.0
        module = self._fitter.module(fit, kept, view)
        numbers = tuple(marker.id for marker in kept)
        unlike = self._fitter.unlike(fit, view, body, alignment.blur)
        return Detection(body, fit.pose, None, error, alignment.sigma, numbers, alignment.blur, module, unlike)

    def _locate(self, body: str, seen: Seen, view: ImageSampler) -> Detection | None:
        rivals = self._fitter.by_corners(seen, view)
        fits = [fit for rival in rivals if (fit := self._fitter.by_image(body, rival, seen, view))]
        fits.sort(key=lambda fit: (-len(fit.markers), fit.residual))
        if not fits or not fits[0].sigma <= self.gates.sigma:
            return None
        best, alternative = fits[0], None
        for fit in fits[1:]:
            as_good = len(fit.markers) == len(best.markers) and fit.residual < self.gates.ratio * best.residual
            if as_good and not turn_between(fit.pose, best.pose) <= self.gates.distinct:
                alternative = fit.pose
        module = self._fitter.module(best, [self._markers[number] for number in best.markers], view)
        unlike = self._fitter.unlike(best, view, body, best.blur)
        return Detection(body, best.pose, alternative, best.error, best.sigma, best.markers, best.blur, module, unlike)


def _side(corners: Corners) -> float:
    """Return the mean edge of a quad, px."""
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).mean())
