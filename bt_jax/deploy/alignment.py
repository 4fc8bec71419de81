"""Refines a pose on the image itself: every edge inside a marker counts, not only its four corners.

Direct alignment by Gauss-Newton (Lucas and Kanade 1981; Baker and Matthews 2004): points of the printed pattern are projected
into the image, and the pose changes until the brightness there is that of the print, up to a gain and an offset of each
marker's own. On renderings this leaves a third of the error of refined corners; and how well pattern and image correlate
tells whether the marker is there at all, whole and not mistaken for another.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence

import cv2
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.markers import MODULES, QUIET, Marker, marker_image

__all__ = ["Alignment", "align", "correlations"]

PER_MODULE = 4  # points along a module's edge
MARGIN = 0.5  # of the quiet zone that is looked at, modules
BLUR = (0.3, 0.12)  # of the pattern, modules: first to be caught, then to be exact
ITERATIONS = (4, 6)
ROBUST = 0.25  # residual, as a share of the contrast, from which points count less (Huber)


@dataclasses.dataclass(frozen=True)
class Alignment:
    """`pose`: the body's frame in the camera's [m]; `residual`: root mean square, share of the contrast; `sigma`: standard
    deviation of the position that follows from it [m]."""

    pose: RigidTransform
    residual: float
    sigma: float


def align(
    image: np.ndarray, pose: RigidTransform, markers: Sequence[Marker], matrix: np.ndarray, distortion: np.ndarray
) -> Alignment:
    """The pose near `pose` at which `markers`, all of one body, look most like `image` f32[h, w]."""
    slopes = (cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32), cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32))
    points = np.concatenate([_points(marker) for marker in markers])
    for blur, iterations in zip(BLUR, ITERATIONS, strict=True):
        patterns = np.stack([_pattern(marker.id, blur) for marker in markers])
        for _ in range(iterations):
            residuals, jacobian = _linearized(image, slopes, pose, points, patterns, matrix, distortion)
            weights = np.minimum(1, ROBUST / np.maximum(np.abs(residuals), 1e-9))
            hessian = jacobian.T @ (weights[:, None] * jacobian)
            step = np.linalg.lstsq(hessian, -jacobian.T @ (weights * residuals), rcond=None)[0]
            pose = _moved(pose, step)
            if np.abs(step).max() < 1e-5:
                break
    residual = float(np.sqrt(np.mean(weights * residuals**2)))
    covariance = residual**2 * np.linalg.pinv(hessian)
    return Alignment(pose, residual, float(np.sqrt(np.trace(covariance[3:, 3:]))))


def correlations(
    image: np.ndarray, pose: RigidTransform, markers: Sequence[Marker], matrix: np.ndarray, distortion: np.ndarray
) -> np.ndarray:
    """f64[m] in -1..1: how the image f32[h, w] correlates with each marker's pattern where the pose has it; -1 where the
    marker is out of the image."""
    points = np.concatenate([_points(marker) for marker in markers])
    pixels, _ = cv2.projectPoints(points, pose.rotation.as_rotvec(), pose.translation, matrix, distortion)
    pixels = pixels.reshape(len(markers), -1, 2)
    seen = _sampled(image, pixels)
    patterns = np.stack([_pattern(marker.id, BLUR[-1]) for marker in markers])
    seen, patterns = (x - x.mean(axis=1, keepdims=True) for x in (seen, patterns))
    scale = np.linalg.norm(seen, axis=1) * np.linalg.norm(patterns, axis=1)
    height, width = image.shape
    inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=(1, 2))
    return np.where(inside & (scale > 1e-6), np.sum(seen * patterns, axis=1) / np.maximum(scale, 1e-6), -1.0)


def _linearized(image, slopes, pose, points, patterns, matrix, distortion) -> tuple[np.ndarray, np.ndarray]:
    """Residuals f64[n], as shares of each marker's contrast, and their derivatives f64[n, 6] by a rotation vector applied on
    the left and by the position; what gain and offset explain is taken out of both."""
    rotated = pose.rotation.apply(points)
    pixels, derivatives = cv2.projectPoints(
        np.ascontiguousarray(rotated), np.zeros(3), pose.translation, matrix, distortion
    )
    pixels, derivatives = pixels.reshape(-1, 2), derivatives[:, :6].reshape(-1, 2, 6)
    seen, across, down = (_sampled(field, pixels[None])[0] for field in (image, *slopes))
    jacobian = across[:, None] * derivatives[:, 0] + down[:, None] * derivatives[:, 1]
    count = patterns.shape[1]
    residuals = np.empty(len(points))
    for i, pattern in enumerate(patterns):
        part = slice(i * count, (i + 1) * count)
        basis = np.stack([pattern, np.ones(count)], axis=1)
        inverse = np.linalg.pinv(basis)
        gain, _ = both = inverse @ seen[part]
        contrast = max(float(gain), 1.0)
        residuals[part] = (seen[part] - basis @ both) / contrast
        jacobian[part] = (jacobian[part] - basis @ (inverse @ jacobian[part])) / contrast
    return residuals, jacobian


def _moved(pose: RigidTransform, step: np.ndarray) -> RigidTransform:
    return RigidTransform.from_components(pose.translation + step[3:], Rotation.from_rotvec(step[:3]) * pose.rotation)


def _sampled(field: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    """f64[m, n]: bilinear values of a field f32[h, w] at pixels f64[m, n, 2]."""
    maps = pixels.astype(np.float32)
    return cv2.remap(field, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)


@functools.lru_cache(maxsize=256)
def _grid() -> np.ndarray:
    """f64[n, 2]: where a marker is looked at, modules from its centre, x to the right and y up, rows from the top."""
    half = MODULES / 2 + MARGIN
    line = (np.arange(round(2 * half * PER_MODULE)) + 0.5) / PER_MODULE - half
    x, y = np.meshgrid(line, -line)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _points(marker: Marker) -> np.ndarray:
    """f64[n, 3]: those places in the body's frame, m."""
    flat = _grid() * marker.size / MODULES
    return marker.pose.apply(np.column_stack([flat, np.zeros(len(flat))]))


@functools.lru_cache(maxsize=256)
def _pattern(number: int, blur: float) -> np.ndarray:
    """f64[n] in 0..1: brightness of the print there, blurred by a Gaussian of `blur` modules."""
    fine = 4 * PER_MODULE
    image = cv2.GaussianBlur(marker_image(number, fine).astype(np.float32) / 255, (0, 0), blur * fine)
    column, row = (_grid() * (1, -1) + MODULES / 2 + QUIET).T * fine - 0.5
    return _sampled(image, np.stack([column, row], axis=1)[None])[0]
