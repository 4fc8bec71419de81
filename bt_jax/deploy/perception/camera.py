"""Where images come from: one small protocol, and the cameras that keep it.

Images are RGB; times are seconds of the cell's clock; the camera's frame has x to the right, y down and z forward.
"""

from __future__ import annotations

import dataclasses
import json
import math
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, runtime_checkable

import cv2
import msgspec
import numpy as np

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.text_files import read_bytes
from bt_jax.deploy.perception.arrays import ColorImage, Distortion, Matrix3
from bt_jax.deploy.perception.calibration import Intrinsics

__all__ = ["Camera", "CameraError", "CameraFrame", "RecordedCamera", "Recorder", "UvcCamera", "open_camera"]


Row = tuple[float, float, float]


class _RecordedFrame(msgspec.Struct):
    """What the file beside a recorded image says."""

    time: float
    matrix: tuple[Row, Row, Row]
    distortion: list[float]


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
    """A camera that OpenCV opens: a device number, a file or an address. A thread keeps the newest image, so that `read`
    never waits. An image that is the last one bit by bit keeps its time: a camera that hangs may go on sending it."""

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


class Recorder:
    """Pass on the images of a camera and write each new one into a folder that `RecordedCamera` reads."""

    def __init__(self, camera: Camera, folder: Path) -> None:
        self.camera, self.folder = camera, folder
        self._count, self._last = 0, float("-inf")

    def read(self) -> CameraFrame:
        frame = self.camera.read()
        if frame.time > self._last:
            encoded = cv2.imencode(".png", cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR))[1].tobytes()
            write_atomic(self.folder / f"{self._count:06d}.png", encoded)
            lens = {"matrix": frame.matrix.tolist(), "distortion": np.ravel(frame.distortion).tolist()}
            write_atomic(self.folder / f"{self._count:06d}.json", json.dumps({"time": frame.time, **lens}))
            self._count, self._last = self._count + 1, frame.time
        return frame

    def close(self) -> None:
        self.camera.close()


class RecordedCamera:
    """Play a folder that `Recorder` wrote: `read` returns one image after the other, or with a `clock` the newest one whose
    time, counted from the first, has come."""

    def __init__(self, folder: Path, clock: Callable[[], float] | None = None) -> None:
        """Raise UserError if the folder holds no recording."""
        self._frames = [_recorded(path) for path in sorted(folder.glob("*.json"))]
        if not self._frames:
            raise UserError(f"{folder} holds no recorded images; give a folder that was written with --record")
        self._clock, self._next = clock, 0
        self._began = clock() if clock else 0.0

    @property
    def times(self) -> list[float]:
        """When each image was taken [s]."""
        return [taken for _, taken, *_ in self._frames]

    def read(self) -> CameraFrame:
        """Return the next image. Raise CameraError at the end of the recording."""
        if self._clock is None:
            if self._next == len(self._frames):
                raise CameraError("the recording is at its end")
            self._next += 1
            return self._load(self._next - 1, 0.0)
        shift = self._began - self._frames[0][1]
        due = [i for i, (_, taken, *_) in enumerate(self._frames) if taken + shift <= self._clock()]
        return self._load(due[-1] if due else 0, shift)

    def close(self) -> None:
        """Do nothing: no file is held open."""

    def _load(self, index: int, shift: float) -> CameraFrame:
        path, taken, matrix, distortion = self._frames[index]
        image = cv2.imread(str(path))
        if image is None:
            raise CameraError(f"{path} cannot be read")
        return CameraFrame(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), taken + shift, matrix, distortion)


def open_camera(
    source: str,
    lens: Intrinsics | None,
    *,
    width: int = 1280,
    height: int = 960,
    clock: Callable[[], float] = time.monotonic,
) -> Camera:
    """Open the camera that a user names: a number or an address, or a folder with a recording, which plays in real time.
    `lens` is None before the calibration; else it says how large the images are. Raise UserError if it cannot be opened."""
    if Path(source).is_dir():
        return RecordedCamera(Path(source), clock)
    if lens is None:
        lens = Intrinsics(np.eye(3), np.zeros(5), width, height, math.nan)
    device = int(source) if source.isdigit() else source
    return UvcCamera(device, lens.matrix, lens.distortion, width=lens.width, height=lens.height, clock=clock)


def _recorded(path: Path) -> tuple[Path, float, Matrix3, Distortion]:
    """Return what a recording says of one image: its file, when it was taken [s], and the lens."""
    try:
        frame = msgspec.json.decode(read_bytes(path), type=_RecordedFrame)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} does not describe a recorded image ({error}); record again") from error
    return path.with_suffix(".png"), frame.time, np.array(frame.matrix, float), np.array(frame.distortion, float)
