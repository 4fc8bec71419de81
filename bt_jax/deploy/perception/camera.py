"""Where images come from: one small protocol, and a camera that keeps it.

Images are RGB; times are seconds of the cell's clock; the camera's frame has x to the right, y down and z forward.
"""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import cv2
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.arrays import ColorImage, Distortion, Matrix3

__all__ = ["Camera", "CameraError", "CameraFrame", "UvcCamera"]


class CameraError(RuntimeError):
    """There is no image; the message says why."""


@dataclasses.dataclass(frozen=True)
class CameraFrame:
    """An image, when it was taken [s], and the lens that took it."""

    image: ColorImage
    time: float
    matrix: Matrix3
    distortion: Distortion


@runtime_checkable
class Camera(Protocol):
    """A source of images."""

    def read(self) -> CameraFrame:
        """Return the newest image, at once; its time says how old it is. Raise CameraError if there is none."""
        ...

    def close(self) -> None:
        """Give the device back."""
        ...


class UvcCamera:
    """A camera that OpenCV opens: a device number or an address. A thread keeps the newest image, so that `read` never
    waits. An image that is the last one bit by bit keeps its time: a camera that hangs may go on sending it."""

    def __init__(
        self,
        source: int | str,
        matrix: Matrix3,
        distortion: Distortion,
        *,
        width: int,
        height: int,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Raise UserError if the camera cannot be opened or has no such size."""
        self._capture = cv2.VideoCapture(source)
        if not self._capture.isOpened():
            raise UserError(
                f"camera {source} cannot be opened; check its cable and its number, and that no program uses it"
            )
        self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, width)
        self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, height)
        self._matrix, self._distortion, self._clock = matrix, distortion, clock
        found, first = self._capture.read()
        if not found or first.shape[:2] != (height, width):
            self._capture.release()
            size = "no image" if not found else f"{first.shape[1]} x {first.shape[0]}"
            raise UserError(
                f"camera {source} gives {size} instead of {width} x {height}; calibrate it at a size that it has, with "
                "--width and --height"
            )
        self._newest = (first, clock())
        self._lost = self._closing = False
        self._thread = threading.Thread(target=self._grab, name="camera", daemon=True)
        self._thread.start()

    def read(self) -> CameraFrame:
        """Return the newest image. Raise CameraError once the camera sends no more."""
        if self._lost:
            raise CameraError("the camera gives no more images")
        image, taken = self._newest
        return CameraFrame(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), taken, self._matrix, self._distortion)

    def close(self) -> None:
        """End the thread and give the device back."""
        self._closing = True
        self._thread.join(timeout=2)
        self._capture.release()

    def _grab(self) -> None:
        while not self._closing:
            found, image = self._capture.read()
            if not found:
                self._lost = True
                return
            if not np.array_equal(image, self._newest[0]):
                self._newest = (image, self._clock())
