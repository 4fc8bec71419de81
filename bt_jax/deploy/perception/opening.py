"""How a user names where images come from, and what that opens."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.calibration import Intrinsics
from bt_jax.deploy.perception.camera import Camera, UvcCamera
from bt_jax.deploy.perception.film import FilmCamera

__all__ = ["open_camera"]


def open_camera(
    source: str,
    lens: Intrinsics | None,
    *,
    width: int = 1280,
    height: int = 960,
    fps: float | None = None,
    realtime: bool = True,
    clock: Callable[[], float] = time.monotonic,
) -> Camera:
    """Open the camera that a user names: a number or an address, or a folder with the pictures of a film, which plays in
    real time or else shows every picture.

    `lens` is None before the calibration; else it says how large the images are. `fps` as for `FilmCamera`. Raise UserError
    if it cannot be opened.
    """
    path = Path(source)
    if path.is_dir():
        return FilmCamera(path, lens, fps, clock=clock if realtime else None)
    if path.is_file() and not source.isdigit():
        raise UserError(
            f"{source} is a file, and neither a camera nor a folder with pictures; take a video apart, for instance with "
            f'ffmpeg -i "{source}" -vf fps=10 FOLDER/%06d.png, and give the folder'
        )
    if lens is None:
        lens = Intrinsics(np.eye(3), np.zeros(5), width, height, math.nan)
    device = int(source) if source.isdigit() else source
    return UvcCamera(device, lens.matrix, lens.distortion, width=lens.width, height=lens.height, clock=clock)
