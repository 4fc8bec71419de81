"""What lens and sensor of a camera make of a perfect image: blur, another brightness, noise."""

from __future__ import annotations

import cv2
import numpy as np

from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.twin.settings import Realism

__all__ = ["Sensor"]

GAMMA = 2.2  # of the images: a stop is a factor of 2 in light
SHIFT = 64  # px in each direction within which the pattern of noise is shifted, since drawing a new one takes too long


class Sensor:
    """Take images as a real camera would, the same ones for the same `seed`."""

    def __init__(self, realism: Realism, seed: int | list[int] = 0) -> None:
        self._realism, self._random = realism, np.random.default_rng(seed)
        shape = (realism.height + SHIFT, realism.width + SHIFT, 3) if realism.noise > 0 else (0, 0, 3)
        noise = realism.noise * self._random.standard_normal(shape, np.float32)
        self._noise = np.rint(noise).astype(np.int16)

    def __call__(self, image: ColorImage) -> ColorImage:
        """Return what the camera makes of an image."""
        realism = self._realism
        gain = 2 ** (realism.exposure / GAMMA) * (1 + realism.flicker * float(self._random.uniform(-1, 1)))
        if gain != 1:
            image = cv2.convertScaleAbs(image, alpha=gain)
        if realism.blur > 0:
            image = cv2.GaussianBlur(image, (0, 0), realism.blur)
        if realism.noise > 0:
            down, right = self._random.integers(0, SHIFT, 2)
            noise = self._noise[down : down + realism.height, right : right + realism.width]
            image = cv2.add(image, noise, dtype=cv2.CV_8U)
        return image
