"""Prints of markers as a lens shows them: sampled at fixed points of the marker, and blurred as the image is.

A blur that is round in the image is an ellipse on a marker that is seen at a slant. It is applied to the print's spectrum,
where a Gaussian is a product, and where the derivative by its variance costs nothing more.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Complex, Float, Int

from bt_jax.deploy.perception.arrays import Matrix3, PointRows, Print
from bt_jax.deploy.perception.markers import MODULES, Marker, marker_image
from bt_jax.deploy.robot.arrays import Point

__all__ = [
    "BlurredPrints",
    "blur_in_modules",
    "blurred_prints",
    "metric",
    "print_points",
    "print_with",
    "turned_prints",
]

PER_MODULE = 3  # points along a module's edge
MARGIN = (
    0.5  # of the bright margin that is looked at, modules: as much on both sides of the border, for the blur's sake
)
FINE = 9  # pixels of a print's image across a module, a multiple of PER_MODULE
LEAST = 0.05  # modules: the least standard deviation of a blur, so that the print can be sampled
INTERPOLATED = 1 / 6  # px^2: variance of the blur that interpolating between pixels adds
FOREIGN = 2.5  # standard deviations of the blur from the sticker's edge within which what is beside it shines in
STEP = 0.05  # modules between the blurs of the prints that images are correlated with

Metric = Float[np.ndarray, "2 2"]
"""Covariance, in modules of the print to the right and down, of a blur of 1 px in the image."""


@dataclasses.dataclass(frozen=True)
class BlurredPrints:
    """m prints at p points each: `brightness` in 0..1, how it changes with the blur's variance [1/px^2] (`softer`), and
    where nothing shines in from beside the sticker (`own`)."""

    brightness: Float[np.ndarray, "m p"]
    softer: Float[np.ndarray, "m p"]
    own: Bool[np.ndarray, "m p"]


def print_points(marker: Marker) -> PointRows:
    """Return where a marker is looked at, in the frame of its body [m], rows of the print from the top."""
    return marker.place(_grid() * marker.size / MODULES)


def metric(focal: Float[np.ndarray, " 2"], rotation: Matrix3, position: Point, marker: Marker) -> Metric:
    """Return the metric of a marker on a body at this pose in the frame of a camera with these focal lengths [px]."""
    x, y, z = rotation @ marker.pose.translation + position
    edges = rotation @ marker.axes[:, :2] * (1, -1) * marker.size / MODULES
    by_module = (edges[:2] - np.outer((x, y), edges[2]) / z) * focal[:, None] / z
    back = np.linalg.pinv(by_module)
    return back @ back.T


def blurred_prints(markers: Sequence[Marker], metrics: Sequence[Metric], variance: float) -> BlurredPrints:
    """Return the prints of `markers` through a lens whose blur has this `variance` [px^2]."""
    spread, variance = np.stack(metrics), variance + INTERPOLATED
    across, down = _frequencies()
    xx, xy, yy = (spread[:, i, j, None, None] for i, j in ((0, 0), (0, 1), (1, 1)))
    stretch = xx * across**2 + 2 * xy * across * down + yy * down**2
    exponent = np.maximum(variance * stretch, LEAST**2 * (across**2 + down**2))
    blurred = np.stack([_spectrum(marker.id) for marker in markers]) * np.exp(-exponent / 2)
    brightness, softer = _sampled(np.stack([blurred, -stretch / 2 * blurred]))
    foreign = FOREIGN * np.sqrt(variance * spread[:, [0, 1], [0, 1]])
    edges = MODULES / 2 + np.array([marker.quiet for marker in markers])
    own = np.all(np.abs(_grid()) < (edges[:, None] - foreign)[:, None], axis=2)
    return BlurredPrints(brightness, softer, own)


@functools.lru_cache(maxsize=1024)
def print_with(number: int, blur: float) -> Print:
    """Return the brightness of a print in 0..1, blurred by a Gaussian of `blur` modules."""
    across, down = _frequencies()
    return _sampled(_spectrum(number) * np.exp(-(blur**2) / 2 * (across**2 + down**2)))


def blur_in_modules(spread: Metric, blur: float) -> float:
    """Return how blurred a print appears through a lens with this blur [px]: on average over its directions, in modules and
    in steps of STEP."""
    modules = np.linalg.det(spread) ** 0.25 * math.sqrt(blur**2 + INTERPOLATED)
    return STEP * max(1, round(min(modules, 1.0) / STEP))


@functools.lru_cache(maxsize=32)
def turned_prints(ids: tuple[int, ...], blur: float) -> Float[np.ndarray, "rows p"]:
    """Return every print, blurred by `blur` modules, in its four orientations, without mean and of length 1."""
    side = math.isqrt(len(_grid()))
    images = [print_with(number, blur).reshape(side, side) for number in ids]
    rows = np.stack([np.rot90(image, quarter).ravel() for image in images for quarter in range(4)])
    rows = rows - rows.mean(axis=1, keepdims=True)
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@functools.cache
def inner_points() -> Bool[np.ndarray, " p"]:
    """Return which of the points lie on a marker's bits, inside of its border."""
    return np.all(np.abs(_grid()) < MODULES / 2 - 1, axis=1)


@functools.cache
def _grid() -> Float[np.ndarray, "p 2"]:
    """Return where a marker is looked at, modules from its centre, x to the right and y up, rows from the top."""
    half = MODULES / 2 + MARGIN
    line = (np.arange(round(2 * half * PER_MODULE)) + 0.5) / PER_MODULE - half
    x, y = np.meshgrid(line, -line)
    return np.stack([x.ravel(), y.ravel()], axis=1)


@functools.lru_cache(maxsize=64)
def _spectrum(number: int) -> Complex[np.ndarray, "side half"]:
    """Return that of a print in a margin of one module, moved left and up by half a pixel: its points lie between pixels."""
    across, down = _frequencies()
    return np.fft.rfft2(marker_image(number, 1, FINE) / 255) * np.exp(0.5j * (across + down) / FINE)


@functools.cache
def _frequencies() -> tuple[Float[np.ndarray, "1 half"], Float[np.ndarray, "side 1"]]:
    """Return those of a spectrum, to the right and down, rad per module."""
    side, turn = (MODULES + 2) * FINE, 2 * np.pi * FINE
    return turn * np.fft.rfftfreq(side)[None], turn * np.fft.fftfreq(side)[:, None]


def _sampled(spectra: Complex[np.ndarray, "*m side half"]) -> Float[np.ndarray, "*m p"]:
    """Return the prints of these spectra at the points of the grid."""
    column, row = _pixels()
    return np.fft.irfft2(spectra)[..., row, column]


@functools.cache
def _pixels() -> Int[np.ndarray, "2 p"]:
    """Return the column and the row of a print's pixel at every point of the grid."""
    return np.rint((_grid() * (1, -1) + MODULES / 2 + 1).T * FINE - 1).astype(int)
