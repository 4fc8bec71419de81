"""How blurred is a picture in which nothing is known? Its steepest edges tell."""

from __future__ import annotations

import math

import cv2
import numpy as np

from bt_jax.deploy.perception.arrays import GrayImage

__all__ = ["edge_blur"]

WINDOW = 31  # px around an edge in which its two sides are found
CONTRAST = 60  # grey levels between the sides of an edge that counts
STEEPEST = 10  # per cent of the places near edges that are believed


def edge_blur(gray: GrayImage) -> float:
    """Return the standard deviation of the blur of a picture's edges [px]; NaN if it has none. The slope of a step of height
    h, blurred by a Gaussian, is at most h / (sqrt(2 pi) sigma)."""
    smooth = cv2.medianBlur(gray, 3)
    window = np.ones((WINDOW, WINDOW), np.uint8)
    height = cv2.dilate(smooth, window).astype(np.float32) - cv2.erode(smooth, window)
    across, down = (cv2.Scharr(smooth, cv2.CV_32F, x, 1 - x, scale=1 / 32) for x in (1, 0))
    slope = cv2.dilate(cv2.magnitude(across, down), window)
    edges = height >= CONTRAST
    if not edges.any():
        return math.nan
    return float(np.percentile(height[edges] / slope[edges], STEEPEST)) / math.sqrt(2 * math.pi)
