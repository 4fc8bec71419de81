"""`python -m bt_jax.deploy calibrate`: lens and place of the cell's camera, with residuals."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import CalibrateArguments
from bt_jax.deploy.execution.settings import CalibrationLimits
from bt_jax.deploy.perception.arrays import ColorImage, Pixel
from bt_jax.deploy.perception.calibration import (
    BoardView,
    alike,
    board_corners,
    calibrate_lens,
    charuco_board,
    locate_camera,
    marker_centres,
)
from bt_jax.deploy.perception.camera import CameraError
from bt_jax.deploy.perception.camera_file import load_intrinsics, load_points, save_camera
from bt_jax.deploy.perception.film import pictures_in, read_picture
from bt_jax.deploy.perception.opening import open_camera

__all__ = ["calibrate_command"]

IMAGES = 30  # of the markers, averaged
LIMITS = CalibrationLimits()
ATTEMPTS = 3000  # images of a live camera to look for the board in


def calibrate_command(arguments: CalibrateArguments) -> int:
    """Do one step and print the residuals; the exit code is 0. Raise UserError."""
    arguments.check()
    console = Console(highlight=False)
    return _lens(arguments, console) if arguments.step == "intrinsics" else _place(arguments, console)


def _lens(arguments: CalibrateArguments, console: Console) -> int:
    board = charuco_board(arguments.square)
    views: list[BoardView] = []
    size: tuple[int, int] | None = None
    live = not Path(arguments.camera).is_dir()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("views of the board", total=arguments.views if live else None)
        for image in _images(arguments):
            if size is not None and image.shape[:2] != size:
                raise UserError(f"{arguments.camera} holds pictures of several sizes; keep those of one camera")
            size = image.shape[:2]
            view = board_corners(image, board)
            if view is not None and not (live and any(alike(view, other, size[1]) for other in views)):
                views.append(view)
                progress.update(bar, completed=len(views))
            if live and len(views) == arguments.views:
                break
    if size is None:
        raise UserError(f"{arguments.camera} holds no pictures; give a folder with png or jpg files, or a camera")
    lens, errors = calibrate_lens(views, size[1], size[0])
    save_camera(arguments.file, lens)
    console.print(
        f"focal length {lens.matrix[0, 0]:.1f} {lens.matrix[1, 1]:.1f} px, centre {lens.matrix[0, 2]:.1f} "
        f"{lens.matrix[1, 2]:.1f} px\nresidual {lens.error:.3f} px over {len(errors)} views, worst view "
        f"{errors.max():.3f} px\nwritten to {arguments.file}; next: calibrate base"
    )
    return 0


def _place(arguments: CalibrateArguments, console: Console) -> int:
    lens = load_intrinsics(arguments.file)
    if arguments.points is None:
        raise UserError(
            "the places of the markers are missing; give --points FILE with a line 'ID: [x, y, z]' for each"
        )
    known = load_points(arguments.points)
    seen: dict[int, list[Pixel]] = {}
    for _, image in zip(range(IMAGES), _images(arguments), strict=False):
        if image.shape[:2] != (lens.height, lens.width):
            raise UserError(
                f"images are {image.shape[1]} x {image.shape[0]}, the lens was calibrated at {lens.width} x {lens.height}; "
                "use the same size"
            )
        for number, centre in marker_centres(image).items():
            seen.setdefault(number, []).append(centre)
    numbers = sorted(set(known) & set(seen))
    pixels = np.array([np.median(seen[number], axis=0) for number in numbers]).reshape(-1, 2)
    place, distances = locate_camera(np.array([known[n] for n in numbers]).reshape(-1, 3), pixels, lens)
    table = Table("marker", "distance from its ray, mm")
    for number, distance in zip(numbers, distances, strict=True):
        table.add_row(str(number), f"{1000 * distance:.2f}")
    console.print(table)
    missing = sorted(set(known) - set(seen))
    if missing:
        console.print(f"not seen: {', '.join(map(str, missing))}")
    if not 0 <= place.residual <= LIMITS.residual:
        raise UserError(
            f"camera and markers disagree by {1000 * place.residual:.1f} mm, and {1000 * LIMITS.residual:g} mm is needed; "
            f"measure again the places in {arguments.points} that are furthest off, and check that they are metres"
        )
    save_camera(arguments.file, lens, place)
    x, y, z = place.pose.translation
    console.print(
        f"camera at ({x:.4f}, {y:.4f}, {z:.4f}) m in the base frame, residual {1000 * place.residual:.2f} mm\n"
        f"written to {arguments.file}"
    )
    return 0


def _images(arguments: CalibrateArguments) -> Iterator[ColorImage]:
    folder = Path(arguments.camera)
    if folder.is_dir():
        yield from map(read_picture, pictures_in(folder))
        return
    camera = open_camera(arguments.camera, None, width=arguments.width, height=arguments.height)
    last = float("-inf")
    try:
        for _ in range(ATTEMPTS):
            frame = camera.read()
            if frame.time > last:
                last = frame.time
                yield frame.image
            else:
                time.sleep(0.005)
    except CameraError as error:
        raise UserError(f"camera {arguments.camera}: {error}; check its cable") from error
    finally:
        camera.close()
