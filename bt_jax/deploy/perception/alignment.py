"""Refine a pose on the image itself: every edge inside a marker counts, not only its four corners.

Direct alignment by Gauss-Newton (Lucas and Kanade 1981; Baker and Matthews 2004): points of the printed pattern are
projected into the image, and the pose changes until the brightness there is that of the print, up to a gain and an
offset of each marker's own. On renderings this leaves a fraction of the error of refined corners; and how well pattern
and image correlate tells whether the marker is there at all, whole and not mistaken for another.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float

from bt_jax.deploy.perception.arrays import Matrix3, PixelRows, PointRows, Print
from bt_jax.deploy.perception.markers import MODULES, Marker, marker_image
from bt_jax.deploy.robot.arrays import Point

__all__ = ["Alignment", "ImageSampler", "align", "correlations"]

PER_MODULE = 3  # points along a module's edge
MARGIN = (
    0.5  # of the bright margin that is looked at, modules: as much on both sides of the border, for the blur's sake
)
BLUR = (0.3, 0.12)  # of the pattern, modules: first to be caught, then to be exact
ITERATIONS = (4, 6)
DAMPING = 1e-9  # keeps a motion that the image does not tell from being singular
EDGELESS = 1e-6  # trace of the normal equations below which there is nothing in the image to align with
PRECISION = 2e-5  # rad and m
BIAS = 0.08  # pixels by which a corner is off whatever the residual, for sampling and blur: as measured in renderings
ROBUST = 0.25  # residual, as a share of the contrast, from which points count less (Huber)
HIDDEN = (
    0.4  # and from which they count as covered by something, and not at all (Tukey's biweight), once the pose is near
)


@dataclasses.dataclass(frozen=True)
class Alignment:
    """A body's frame in the camera's, and how well the image fits; both measures are inf if the image shows nothing."""

    rotation: Matrix3
    position: Point
    residual: float  # root mean square, as a share of the contrast
    sigma: (
        float  # standard deviation of the position, from the residual of independent points and from coarse pixels, m
    )


class ImageSampler:
    """An image of a camera without distortion, with its derivatives."""

    def __init__(self, image: Float[np.ndarray, "H W"], matrix: Matrix3) -> None:
        self.image, self.matrix = image, matrix
        across = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32)
        down = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32)
        self.focal, self._centre = np.diag(matrix)[:2].copy(), matrix[:2, 2].copy()
        self._fields = cv2.merge([image, across, down])

    def project(self, points: PointRows) -> PixelRows:
        """Return where the image shows points of the camera's frame."""
        return points[:, :2] / points[:, 2:] * self.focal + self._centre

    def brightness(self, pixels: Float[np.ndarray, "m p 2"]) -> Float[np.ndarray, "m p"]:
        """Return the brightness at pixels, interpolated bilinearly."""
        return _sampled(self.image, pixels)

    def linearized(
        self, placed: PointRows, arms: PointRows
    ) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 6"]]:
        """Return the brightness at points of the camera's frame, and its derivatives by a turn of the `arms`, which lead
        from the body's origin to the points, and by a shift."""
        x, y, z = placed.T
        seen, across, down = _sampled(self._fields, self.project(placed)[None])[0].T
        by_x, by_y = across * self.focal[0] / z, down * self.focal[1] / z
        by_z = -(by_x * x + by_y * y) / z
        a, b, c = arms.T
        turns = (b * by_z - c * by_y, c * by_x - a * by_z, a * by_y - b * by_x)
        return seen, np.stack([*turns, by_x, by_y, by_z], axis=1)


def align(
    view: ImageSampler, rotation: Matrix3, position: Point, markers: Sequence[Marker], *, near: bool = False
) -> Alignment:
    """Return the pose, near a given one of a body in the camera's frame, at which its `markers` look most like the image;
    `near` says that the given one is off by less than a pixel or so."""
    points = np.concatenate([_points(marker) for marker in markers])
    for blur, iterations in list(zip(BLUR, ITERATIONS, strict=True))[near:]:
        patterns = np.stack([_pattern(marker.id, blur) for marker in markers])
        weights = np.ones(patterns.size)
        for turn in range(iterations):
            arms = points @ rotation.T
            residuals, jacobian = _normalized(*view.linearized(arms + position, arms), patterns, weights)
            if blur == BLUR[-1] and turn > 0:
                weights = np.maximum(1 - (residuals / HIDDEN) ** 2, 0) ** 2
            else:
                weights = np.minimum(1, ROBUST / np.maximum(np.abs(residuals), 1e-9))
            weighted = weights[:, None] * jacobian
            hessian = jacobian.T @ weighted
            if not np.trace(hessian) >= EDGELESS:
                return Alignment(rotation, position, math.inf, math.inf)
            step = -np.linalg.solve(hessian + DAMPING * np.eye(6) * np.trace(hessian), weighted.T @ residuals)
            rotation, position = cv2.Rodrigues(step[:3])[0] @ rotation, position + step[3:]
            if np.abs(step).max() < PRECISION:
                break
    residual = float(np.sqrt(np.sum(weights * residuals**2) / max(float(weights.sum()), 1.0)))
    covariance = residual**2 * np.linalg.pinv(hessian) + _coarseness(view, rotation, position, markers)
    return Alignment(rotation, position, residual, float(np.sqrt(np.trace(covariance[3:, 3:]))))


def _coarseness(
    view: ImageSampler, rotation: Matrix3, position: Point, markers: Sequence[Marker]
) -> Float[np.ndarray, "6 6"]:
    """Return the covariance of turn [rad] and shift [m] if every corner is off by BIAS."""
    arms = np.concatenate([marker.corners for marker in markers]) @ rotation.T
    x, y, z = (arms + position).T
    one, none = np.ones_like(z), np.zeros_like(z)
    across = np.stack([one, none, -x / z], axis=1) * (view.focal[0] / z)[:, None]
    down = np.stack([none, one, -y / z], axis=1) * (view.focal[1] / z)[:, None]
    gradients, arms = np.concatenate([across, down]), np.concatenate([arms, arms])
    jacobian = np.concatenate([np.cross(arms, gradients), gradients], axis=1)
    return BIAS**2 * np.linalg.pinv(jacobian.T @ jacobian)


def correlations(
    view: ImageSampler, rotation: Matrix3, position: Point, markers: Sequence[Marker], ids: Sequence[int]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return how the image correlates with each marker's pattern where the pose has it, and at most with another pattern:
    that of any of the `ids`, turned by any quarter. Both are in -1..1; the first is -1 for a marker out of the image."""
    points = np.concatenate([_points(marker) for marker in markers])
    pixels = view.project(points @ rotation.T + position).reshape(len(markers), -1, 2)
    seen = view.brightness(pixels)
    seen = seen - seen.mean(axis=1, keepdims=True)
    seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-6)
    values = (seen @ _turned(tuple(ids)).T).reshape(len(markers), len(ids), 4)
    rows, columns = np.arange(len(markers)), [ids.index(marker.id) for marker in markers]
    own = values[rows, columns, 0].copy()
    values[rows, columns, 0] = -1.0
    height, width = view.image.shape
    inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=(1, 2))
    return np.where(inside, own, -1.0), values.max(axis=(1, 2))


def _normalized(
    seen: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n 6"],
    patterns: Float[np.ndarray, "m p"],
    weights: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 6"]]:
    """Return the residuals of n = m * p points, as shares of each marker's contrast, and their derivatives, both without
    what gain and offset explain of the points that count by `weights`."""
    values = np.concatenate([seen[:, None], jacobian], axis=1).reshape(*patterns.shape, 7)
    shares = weights.reshape(patterns.shape)
    shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-9)
    values = values - np.einsum("mn,mnk->mk", shares, values)[:, None]
    centred = patterns - np.einsum("mn,mn->m", shares, patterns)[:, None]
    along = shares * centred
    gains = np.einsum("mn,mnk->mk", along, values) / np.maximum(np.sum(along * centred, axis=1, keepdims=True), 1e-9)
    values -= centred[:, :, None] * gains[:, None]
    values /= np.maximum(gains[:, :1], 1.0)[:, None]
    values = values.reshape(-1, 7)
    return values[:, 0], values[:, 1:]


def _sampled(field: Float[np.ndarray, "H W *c"], pixels: Float[np.ndarray, "m p 2"]) -> Float[np.ndarray, "m p *c"]:
    """Return the values of a field at pixels, interpolated bilinearly."""
    maps = pixels.astype(np.float32)
    return cv2.remap(field, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)


@functools.cache
def _grid() -> Float[np.ndarray, "p 2"]:
    """Return where a marker is looked at, modules from its centre, x to the right and y up, rows from the top."""
    half = MODULES / 2 + MARGIN
    line = (np.arange(round(2 * half * PER_MODULE)) + 0.5) / PER_MODULE - half
    x, y = np.meshgrid(line, -line)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def _points(marker: Marker) -> PointRows:
    """Return those places in the body's frame."""
    return marker.place(_grid() * marker.size / MODULES)


@functools.lru_cache(maxsize=256)
def _pattern(number: int, blur: float) -> Print:
    """Return the brightness of the print there in 0..1, blurred by a Gaussian of `blur` modules."""
    fine = 4 * PER_MODULE
    image = cv2.GaussianBlur(marker_image(number, 1, fine).astype(np.float32) / 255, (0, 0), blur * fine)
    column, row = (_grid() * (1, -1) + MODULES / 2 + 1).T * fine - 0.5
    return _sampled(image, np.stack([column, row], axis=1)[None])[0]


@functools.lru_cache(maxsize=16)
def _turned(ids: tuple[int, ...]) -> Float[np.ndarray, "rows p"]:
    """Return every pattern in its four orientations, without mean and of length 1."""
    side = math.isqrt(len(_grid()))
    images = [_pattern(number, BLUR[-1]).reshape(side, side) for number in ids]
    rows = np.stack([np.rot90(image, quarter).ravel() for image in images for quarter in range(4)])
    rows = rows - rows.mean(axis=1, keepdims=True)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)
