"""What lens and sensor of a camera make of a perfect image: blur, another brightness, noise."""

from __future__ import annotations

import cv2
import numpy as np

from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.twin.settings import Realism

__all__ = ["Sensor"]

GAMMA = 2.2  # of the images: a stop is a factor of 2 in light
PATTERNS = 4  # of noise, drawn once and shifted for every image, since drawing costs more than rendering


class Sensor:
    """Take images as a real camera would, the same ones for the same `seed`."""

    def __init__(self, realism: Realism, seed: int | list[int] = 0) -> None:
        self._realism, self._random = realism, np.random.default_rng(seed)
        shape = (PATTERNS, realism.height, realism.width, 3)
        self._patterns = realism.noise * self._random.standard_normal(
            shape if realism.noise else (0, 1, 1, 3), np.float32
        )

    def __call__(self, image: ColorImage) -> ColorImage:
        """Return what the camera makes of an image."""
        realism = self._realism
        gain = 2 ** (realism.exposure / GAMMA) * (1 + realism.flicker * float(self._random.uniform(-1, 1)))
        if realism.blur == 0 and realism.noise == 0 and gain == 1:
            return image
        seen = image.astype(np.float32) * np.float32(gain)
        if realism.blur > 0:
            cv2.GaussianBlur(seen, (0, 0), realism.blur, dst=seen)
        if realism.noise > 0:
            pattern = self._patterns[self._random.integers(PATTERNS)]
            seen += np.roll(pattern, self._random.integers(0, min(pattern.shape[:2]), 2), (0, 1))
        return np.clip(np.rint(seen), 0, 255).astype(np.uint8)
