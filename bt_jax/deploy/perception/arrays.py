"""The arrays of perception, by what they hold."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

__all__ = ["ColorImage", "Corners", "Distortion", "GrayImage", "Matrix3", "Pixel", "PixelRows", "PointRows", "Print"]

ColorImage = UInt8[np.ndarray, "H W 3"]
"""RGB, rows from the top."""
GrayImage = UInt8[np.ndarray, "H W"]
"""Brightness, rows from the top."""
Matrix3 = Float[np.ndarray, "3 3"]
"""A rotation, or a camera matrix as OpenCV has it: focal lengths and centre [px]."""
Distortion = Float[np.ndarray, " k"]
"""Distortion coefficients in OpenCV's order."""
Pixel = Float[np.ndarray, " 2"]
"""A place in an image: column, row [px]; the centre of the first pixel is (0, 0)."""
PixelRows = Float[np.ndarray, "n 2"]
"""Places in an image, one a row."""
PointRows = Float[np.ndarray, "n 3"]
"""Positions [m], one a row."""
Corners = Float[np.ndarray, "4 2"]
"""The corners of one marker in an image [px], clockwise from the top left as printed."""
Print = Float[np.ndarray, " p"]
"""Brightness at the places where a marker is looked at."""
