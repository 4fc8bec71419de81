"""Refine a pose on the image itself: every edge inside a marker counts, not only its four corners.

Direct alignment by Gauss-Newton (Lucas and Kanade 1981; Baker and Matthews 2004): points of the printed pattern are
projected into the image, and the pose changes until the brightness there is that of the print, up to a gain and an
offset of each marker's own. The print is compared as the lens shows it: the blur, a Gaussian in the image, is fitted
together with the pose, since a print that is sharper than its image would be pulled towards the camera. On renderings
this leaves a fraction of the error of refined corners; and how well pattern and image correlate tells whether the marker
is there at all, whole and not mistaken for another.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float

from bt_jax.deploy.perception.arrays import Matrix3, PixelRows, PointRows
from bt_jax.deploy.perception.markers import Marker
from bt_jax.deploy.perception.prints import (
    BlurredPrints,
    blur_in_modules,
    blurred_prints,
    inner_points,
    metric,
    print_points,
    print_with,
    turned_prints,
)
from bt_jax.deploy.robot.arrays import Point

__all__ = ["SHARP", "Alignment", "ImageSampler", "align", "bits_like", "correlations"]

CAUGHT = 0.3  # standard deviation of the pattern's blur while the pose is only caught, modules
ITERATIONS = (4, 8)  # to catch it, and to be exact
SHARP, SOFTEST = 0.5, 4.0  # px, of the lens's blur: where its search begins, and the most that is tried
SETTLED = 0.02  # px^2 by which the variance of the blur may still change at the end
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
    blur: float = SHARP  # standard deviation of the lens's blur, px


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
    points = np.concatenate([print_points(marker) for marker in markers])
    variance = SHARP**2
    for exact in (False, True)[near:]:
        weights, free = np.ones(len(points)), slice(None) if exact else slice(6)
        for turn in range(ITERATIONS[exact]):
            arms = points @ rotation.T
            prints = _prints(view, rotation, position, markers, variance if exact else None)
            residuals, jacobian = _normalized(*view.linearized(arms + position, arms), prints, weights)
            if exact and turn > 0:
                weights = np.maximum(1 - (residuals / HIDDEN) ** 2, 0) ** 2
            else:
                weights = np.minimum(1, ROBUST / np.maximum(np.abs(residuals), 1e-9))
            weights = weights * prints.own.ravel()
            weighted = weights[:, None] * jacobian[:, free]
            hessian = jacobian[:, free].T @ weighted
            if not np.trace(hessian[:6, :6]) >= EDGELESS:
                return Alignment(rotation, position, math.inf, math.inf)
            damped = hessian + DAMPING * np.eye(len(hessian)) * np.trace(hessian)
            step = -np.linalg.solve(damped, weighted.T @ residuals)
            rotation, position = cv2.Rodrigues(step[:3])[0] @ rotation, position + step[3:6]
            before, variance = variance, float(np.clip(variance + step[6:].sum(), 0.0, SOFTEST**2))
            if np.abs(step[:6]).max() < PRECISION and abs(variance - before) < SETTLED:
                break
    residual = float(np.sqrt(np.sum(weights * residuals**2) / max(float(weights.sum()), 1.0)))
    covariance = residual**2 * np.linalg.pinv(hessian[:6, :6]) + _coarseness(view, rotation, position, markers)
    sigma = float(np.sqrt(np.trace(covariance[3:, 3:])))
    return Alignment(rotation, position, residual, sigma, math.sqrt(variance))


def _prints(
    view: ImageSampler, rotation: Matrix3, position: Point, markers: Sequence[Marker], variance: float | None
) -> BlurredPrints:
    """Return the prints through a lens whose blur has this `variance` [px^2]; blurred by CAUGHT themselves for None."""
    if variance is None:
        brightness = np.stack([print_with(marker.id, CAUGHT) for marker in markers])
        return BlurredPrints(brightness, np.zeros_like(brightness), np.ones(brightness.shape, bool))
    return blurred_prints(markers, [metric(view.focal, rotation, position, marker) for marker in markers], variance)


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
    view: ImageSampler,
    rotation: Matrix3,
    position: Point,
    markers: Sequence[Marker],
    ids: Sequence[int],
    blur: float = SHARP,
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Return how the image correlates with each marker's pattern where the pose has it, and at most with another pattern:
    that of any of the `ids`, turned by any quarter. Both are in -1..1; the first is -1 for a marker out of the image."""
    points = np.concatenate([print_points(marker) for marker in markers])
    pixels = view.project(points @ rotation.T + position).reshape(len(markers), -1, 2)
    seen = view.brightness(pixels)
    seen = seen - seen.mean(axis=1, keepdims=True)
    seen /= np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-6)
    spreads = [blur_in_modules(metric(view.focal, rotation, position, marker), blur) for marker in markers]
    prints = [turned_prints(tuple(ids), spread) for spread in spreads]
    values = np.stack([turned @ row for turned, row in zip(prints, seen, strict=True)]).reshape(-1, len(ids), 4)
    rows, columns = np.arange(len(markers)), [ids.index(marker.id) for marker in markers]
    own = values[rows, columns, 0].copy()
    values[rows, columns, 0] = -1.0
    height, width = view.image.shape
    inside = np.all((pixels >= 0) & (pixels <= (width - 1, height - 1)), axis=(1, 2))
    return np.where(inside, own, -1.0), values.max(axis=(1, 2))


def bits_like(
    view: ImageSampler, rotation: Matrix3, position: Point, markers: Sequence[Marker], blur: float
) -> Float[np.ndarray, " m"]:
    """Return how the image correlates with the bits of each marker where the pose has it, -1..1; NaN for one that is not
    whole in the image. Border and margin do not count: anything dark on the paper looks like them."""
    inner, likes = inner_points(), []
    height, width = view.image.shape
    for marker in markers:
        pixels = view.project(print_points(marker) @ rotation.T + position)
        if not np.all((pixels >= 0) & (pixels <= (width - 1, height - 1))):
            likes.append(math.nan)
            continue
        bits = print_with(marker.id, blur_in_modules(metric(view.focal, rotation, position, marker), blur))[inner]
        seen = view.brightness(pixels[None, inner])[0]
        bits, seen = bits - bits.mean(), seen - seen.mean()
        likes.append(float(bits @ seen / max(np.linalg.norm(bits) * np.linalg.norm(seen), 1e-6)))
    return np.array(likes)


def _normalized(
    seen: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n 6"],
    prints: BlurredPrints,
    weights: Float[np.ndarray, " n"],
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 7"]]:
    """Return the residuals of n = m * p points, as shares of each marker's contrast, and their derivatives by pose and by
    the variance of the blur, all without what gain and offset explain of the points that count by `weights`."""
    patterns = prints.brightness
    values = np.concatenate([seen[:, None], jacobian, prints.softer.reshape(-1, 1)], axis=1)
    values = values.reshape(*patterns.shape, 8)
    weights = weights * prints.own.ravel()
    shares = weights.reshape(patterns.shape)
    shares = shares / np.maximum(shares.sum(axis=1, keepdims=True), 1e-9)
    values = values - np.einsum("mn,mnk->mk", shares, values)[:, None]
    centred = patterns - np.einsum("mn,mn->m", shares, patterns)[:, None]
    along = shares * centred
    gains = np.einsum("mn,mnk->mk", along, values) / np.maximum(np.sum(along * centred, axis=1, keepdims=True), 1e-9)
    values -= centred[:, :, None] * gains[:, None]
    values[..., :7] /= np.maximum(gains[:, :1], 1.0)[:, None]
    values[..., 7] *= -1
    values = values.reshape(-1, 8)
    return values[:, 0], values[:, 1:]


def _sampled(field: Float[np.ndarray, "H W *c"], pixels: Float[np.ndarray, "m p 2"]) -> Float[np.ndarray, "m p *c"]:
    """Return the values of a field at pixels, interpolated bilinearly."""
    maps = pixels.astype(np.float32)
    return cv2.remap(field, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).astype(float)
