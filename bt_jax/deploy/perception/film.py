"""A folder of pictures as a camera: what a video was taken apart into, or what `Recorder` wrote.

When each picture was taken is told by, in this order: a given number of pictures a second; the files of a recording; the
names, if each ends in seconds with decimals (`12.345.png`) or in the milli-, micro- or nanoseconds since 1970
(`1718000000123.png`); and the times that a camera has written into its pictures (EXIF). When a file was changed tells
nothing: copying changes it.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import cv2
import msgspec
import numpy as np
from PIL import ExifTags, Image

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.text_files import read_bytes
from bt_jax.deploy.perception.arrays import ColorImage, Distortion, Matrix3
from bt_jax.deploy.perception.calibration import Intrinsics
from bt_jax.deploy.perception.camera import Camera, CameraError, CameraFrame

__all__ = ["FilmCamera", "FilmEnded", "Recorder", "pictures_in", "read_picture"]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
EPOCH = {13: 1e-3, 16: 1e-6, 19: 1e-9}  # digits of a time since 1970 -> its unit [s]

Row = tuple[float, float, float]


class FilmEnded(CameraError):
    """There are no more pictures."""


class _RecordedFrame(msgspec.Struct):
    """What the file beside a recorded picture says."""

    time: float
    matrix: tuple[Row, Row, Row]
    distortion: list[float]


@dataclasses.dataclass(frozen=True)
class _Lens:
    """What took a picture; `size` is (width, height) [px], None if it is not told."""

    matrix: Matrix3
    distortion: Distortion
    size: tuple[int, int] | None = None


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures of a folder, in the natural order of their names."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and not path.name.startswith(".")]
    return sorted(
        found, key=lambda path: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.stem)]
    )


def read_picture(path: Path) -> ColorImage:
    """Return a picture, its pixels as the sensor had them, whichever way the camera was held. Raise UserError."""
    image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None:
        raise UserError(f"{path} cannot be read as a picture; remove it from the folder")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


class FilmCamera:
    """Play a folder of pictures: `read` returns one after the other, or with a `clock` the newest one whose time, counted
    from the first, has come. A recording tells its own lens; other pictures were taken by `lens`."""

    def __init__(
        self,
        folder: Path,
        lens: Intrinsics | None,
        fps: float | None = None,
        *,
        clock: Callable[[], float] | None = None,
    ) -> None:
        """Raise UserError if the folder holds no pictures or they tell no times."""
        self._pictures = pictures_in(folder)
        if not self._pictures:
            raise UserError(f"{folder} holds no pictures; give a folder with png or jpg files")
        recorded = _recording(self._pictures)
        self._lenses = [_lens(frame, lens) for frame in recorded] or [_lens(None, lens)] * len(self._pictures)
        if recorded and fps is None:
            self._times = [frame.time for frame in recorded]
        else:
            self._times = _times(folder, self._pictures, fps)
        self._clock, self._next = clock, 0
        self._shift = clock() - self._times[0] if clock else 0.0

    def read(self) -> CameraFrame:
        """Return the next picture. Raise FilmEnded after the last, and UserError if one cannot be read or has another size
        than its lens."""
        if self._clock is not None:
            now = self._clock() - self._shift
            return self._load(max(0, sum(time <= now for time in self._times) - 1))
        if self._next == len(self._pictures):
            raise FilmEnded("the film is at its end")
        self._next += 1
        return self._load(self._next - 1)

    def close(self) -> None:
        """Do nothing: no file is held open."""

    def _load(self, index: int) -> CameraFrame:
        path, lens = self._pictures[index], self._lenses[index]
        image = read_picture(path)
        height, width = image.shape[:2]
        if lens.size is not None and lens.size != (width, height):
            raise UserError(
                f"{path} is {width} x {height} and the lens was calibrated at {lens.size[0]} x {lens.size[1]}; use the same "
                "size"
            )
        return CameraFrame(image, self._times[index] + self._shift, lens.matrix, lens.distortion)


class Recorder:
    """Pass on the images of a camera and write each new one into a folder, as a recording that `FilmCamera` plays."""

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


def _recording(pictures: Sequence[Path]) -> list[_RecordedFrame]:
    """Return what a recording says of each picture, nothing if this is none. Raise UserError if it is damaged."""
    files = [path.with_suffix(".json") for path in pictures]
    return [_recorded(file) for file in files] if all(file.is_file() for file in files) else []


def _recorded(path: Path) -> _RecordedFrame:
    try:
        return msgspec.json.decode(read_bytes(path), type=_RecordedFrame)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} does not describe a recorded image ({error}); record again") from error


def _lens(recorded: _RecordedFrame | None, lens: Intrinsics | None) -> _Lens:
    """Return the lens of a picture: that of the recording, else the given one; without both, one that is not known."""
    if recorded is not None:
        return _Lens(np.array(recorded.matrix, float), np.array(recorded.distortion, float))
    if lens is None:
        return _Lens(np.eye(3), np.zeros(5))
    return _Lens(lens.matrix, lens.distortion, (lens.width, lens.height))


def _times(folder: Path, pictures: Sequence[Path], fps: float | None) -> list[float]:
    """Return when each picture of a film that is no recording was taken [s]."""
    if fps is not None:
        return [i / fps for i in range(len(pictures))]
    sources: tuple[Callable[[Path], float | None], ...] = (_named_time, _written_time)
    for time_of in sources:
        times: list[float] = []
        for path in pictures:
            time = time_of(path)
            if time is None or (times and time <= times[-1]):
                break
            times.append(time)
        else:
            return times
    raise UserError(
        f"the pictures in {folder} do not tell when they were taken, neither by their names nor by EXIF; name each by its "
        "time in seconds, such as 12.345.png, or to watch a person say how many a second there are with --fps"
    )


def _named_time(path: Path) -> float | None:
    """Return the time at the end of a file's name [s], None if there is none."""
    whole = re.search(r"(?<!\d)(\d+)$", path.stem)
    if whole is not None and len(whole[1]) in EPOCH and not re.search(r"\.\d+$", path.stem):
        return int(whole[1]) * EPOCH[len(whole[1])]
    seconds = re.search(r"(?<![\d.])(\d+\.\d+)$", path.stem)
    return None if seconds is None else float(seconds[1])


def _written_time(path: Path) -> float | None:
    """Return when the camera says that it took a picture [s], None if it does not."""
    try:
        with Image.open(path) as image:
            tags = image.getexif().get_ifd(ExifTags.IFD.Exif)
        taken = datetime.strptime(str(tags[ExifTags.Base.DateTimeOriginal]), "%Y:%m:%d %H:%M:%S")
        part = float(f"0.{str(tags.get(ExifTags.Base.SubsecTimeOriginal, '0')).strip()}")
    except (OSError, KeyError, ValueError):
        return None
    return (taken - datetime(1970, 1, 1)).total_seconds() + part
