"""A folder of pictures as a camera: what a video was taken apart into, or what `Recorder` wrote.

When each picture was taken is told by, in this order: a given number of pictures a second; the files of a recording; the
names, if each ends in seconds with decimals (`12.345.png`) or in the milli-, micro- or nanoseconds since 1970
(`1718000000123.png`); and the times that a camera has written into its pictures (EXIF). When a file was changed tells
nothing: copying changes it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from datetime import datetime
from pathlib import Path

import cv2
from PIL import ExifTags, Image

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.calibration import Intrinsics
from bt_jax.deploy.perception.camera import CameraError, CameraFrame, RecordedCamera

__all__ = ["FilmCamera", "FilmEnded", "pictures_in"]

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
EPOCH = {13: 1e-3, 16: 1e-6, 19: 1e-9}  # digits of a time since 1970 -> its unit [s]


class FilmEnded(CameraError):
    """There are no more pictures."""


def pictures_in(folder: Path) -> list[Path]:
    """Return the pictures of a folder, in the natural order of their names."""
    found = [path for path in folder.iterdir() if path.suffix.lower() in PICTURES and not path.name.startswith(".")]
    return sorted(
        found, key=lambda path: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.stem)]
    )


class FilmCamera:
    """Show the pictures of a folder one after the other, as `lens` took them."""

    def __init__(self, folder: Path, lens: Intrinsics, fps: float | None = None) -> None:
        """Raise UserError if the folder holds no pictures or they tell no times."""
        self._pictures = pictures_in(folder)
        if not self._pictures:
            raise UserError(f"{folder} holds no pictures; give a folder with png or jpg files")
        self._lens, self._next = lens, 0
        self._times = _times(folder, self._pictures, fps)

    def read(self) -> CameraFrame:
        """Return the next picture. Raise FilmEnded after the last, and UserError if one cannot be read."""
        if self._next == len(self._pictures):
            raise FilmEnded("the film is at its end")
        path, time = self._pictures[self._next], self._times[self._next]
        self._next += 1
        image = cv2.imread(str(path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if image is None:
            raise UserError(f"{path} cannot be read as a picture; remove it from the film")
        if image.shape[:2] != (self._lens.height, self._lens.width):
            raise UserError(
                f"{path} is {image.shape[1]} x {image.shape[0]} and the lens was calibrated at {self._lens.width} x "
                f"{self._lens.height}; use the same size"
            )
        return CameraFrame(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), time, self._lens.matrix, self._lens.distortion)

    def close(self) -> None:
        """Do nothing: no file is held open."""


def _times(folder: Path, pictures: Sequence[Path], fps: float | None) -> list[float]:
    """Return when each picture was taken [s]."""
    if fps is not None:
        return [i / fps for i in range(len(pictures))]
    if all(path.with_suffix(".json").is_file() for path in pictures):
        return RecordedCamera(folder).times
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
        f"the pictures in {folder} do not tell when they were taken, neither by their names nor by EXIF; say how many a "
        "second there are with --fps"
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
