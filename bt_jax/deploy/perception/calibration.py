"""Calibration of the cell's camera: its lens from pictures of a ChArUco board, its place from markers whose places in the
robot's base frame are known, for instance because an arm's tip was led to their centres.

Both results live in one file, see `camera_file`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.settings import CalibrationLimits
from bt_jax.deploy.perception.arrays import (
    ColorImage,
    Corners,
    Distortion,
    GrayImage,
    Matrix3,
    Pixel,
    PixelRows,
    PointRows,
)
from bt_jax.deploy.perception.markers import marker_dictionary

__all__ = [
    "BOARD",
    "BoardView",
    "CameraPose",
    "Intrinsics",
    "alike",
    "board_corners",
    "calibrate_lens",
    "charuco_board",
    "locate_camera",
    "marker_centres",
]

BOARD = (5, 7)  # squares across and down; on A4
SQUARE = 0.035  # edge of one as printed, m
LEAST_CORNERS, LEAST_VIEWS, LEAST_POINTS = 8, 6, 4
ALIKE = 0.05  # of the image's width: two views are one if no corner lies further apart
LIMITS = CalibrationLimits()
BoardView = tuple[PointRows, PixelRows]
"""Corners of the board: in its own frame, and where one image shows them."""


@dataclasses.dataclass(frozen=True)
class Intrinsics:
    """A lens, for images of this size."""

    matrix: Matrix3
    distortion: Distortion
    width: int  # px
    height: int
    error: float  # root mean square reprojection error of the calibration, px


@dataclasses.dataclass(frozen=True)
class CameraPose:
    """`pose`: the camera's frame (x right, y down, z forward) in the robot's base [m]. `residual`: root mean square distance
    between the known points and the rays on which they were seen [m]; `points`: how many there were."""

    pose: RigidTransform
    residual: float
    points: int


def charuco_board(square: float = SQUARE) -> cv2.aruco.CharucoBoard:
    """Return the board to print; its markers are from another dictionary than those of the boxes."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    return cv2.aruco.CharucoBoard(BOARD, square, 0.75 * square, dictionary)


def board_corners(image: ColorImage | GrayImage, board: cv2.aruco.CharucoBoard) -> BoardView | None:
    """Return the board's corners that an image shows, None if they are too few to be of use."""
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(gray)
    if ids is None or len(ids) < LEAST_CORNERS:
        return None
    points = np.asarray(board.getChessboardCorners(), np.float32)[np.ravel(ids)]
    if np.linalg.matrix_rank(points[:, :2] - points[0, :2]) < 2:
        return None
    return points, np.asarray(corners, np.float32).reshape(-1, 2)


def calibrate_lens(
    views: Sequence[BoardView], width: int, height: int
) -> tuple[Intrinsics, Float[np.ndarray, " views"]]:
    """Return the lens from several views of the board, and the root mean square error [px] of each; views alike count once.

    Raise UserError if there are too few, or if they do not determine the lens: its residual is small then all the same.
    """
    distinct: list[BoardView] = []
    for view in views:
        if not any(alike(view, other, width) for other in distinct):
            distinct.append(view)
    if len(distinct) < LEAST_VIEWS:
        same = f" ({len(views) - len(distinct)} more are like others)" if len(views) > len(distinct) else ""
        raise UserError(
            f"the pictures show the board from {len(distinct)} of the {LEAST_VIEWS} sides that are needed{same}; take more, "
            "with the board turned and at other distances"
        )
    points, pixels = zip(*distinct, strict=True)
    try:
        error, matrix, distortion, turns, _, deviations, _, errors = cv2.calibrateCameraExtended(
            list(points), list(pixels), (width, height), np.eye(3), np.zeros(5)
        )
    except cv2.error as problem:  # the corners of a view coincide, for instance
        raise UserError(
            "no lens explains the pictures; take others, sharp ones on which the whole board is large"
        ) from problem
    if not 0 <= error <= LIMITS.reprojection:
        raise UserError(
            f"the lens explains the pictures to {error:.2f} px, and {LIMITS.reprojection:g} is needed; glue the board to "
            "something flat, take sharper pictures, and do not change the focus"
        )
    focal = float(np.max(deviations.ravel()[:2] / np.diag(matrix)[:2]))
    centre = float(np.max(deviations.ravel()[2:4])) / width
    turned = _largest_turn(turns)
    if not (0 <= focal <= LIMITS.focal and 0 <= centre <= LIMITS.centre and turned >= LIMITS.turned):
        remedy = "take more and sharper pictures"
        if not turned >= LIMITS.turned:
            remedy = "take more, with the board turned by 20 to 40 degrees to every side and at other distances"
        raise UserError(
            f"the board was turned by {turned:.0f} degrees at most, and the pictures leave the focal length open by "
            f"{focal:.2%} and the centre by {centre:.2%} of the width, where {LIMITS.focal:.0%} is needed; {remedy}"
        )
    return Intrinsics(matrix, np.ravel(distortion)[:5], width, height, float(error)), np.ravel(errors)


def _largest_turn(turns: Sequence[Float[np.ndarray, "3 1"]]) -> float:
    """Return the largest angle between the board's normals in two views [deg], from its rotation vectors."""
    normals = np.array([Rotation.from_rotvec(np.ravel(turn)).as_matrix()[:, 2] for turn in turns])
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))


def alike(view: BoardView, other: tuple[Float[np.ndarray, "m 3"], Float[np.ndarray, "m 2"]], width: int) -> bool:
    """Do two views show the board from nearly the same side, in images of this width [px]? They do not if too few corners
    are in both to tell."""
    there = {tuple(point): pixel for point, pixel in zip(*other, strict=True)}
    moved = [np.linalg.norm(pixel - there[tuple(p)]) for p, pixel in zip(*view, strict=True) if tuple(p) in there]
    return len(moved) >= LEAST_CORNERS and float(max(moved)) < ALIKE * width


def marker_centres(image: ColorImage | GrayImage) -> dict[int, Pixel]:
    """Return the centre, where the diagonals meet, of every marker of the cell's dictionary in an image, by id."""
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    quads, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(), parameters).detectMarkers(gray)
    numbers = [] if ids is None else [int(number) for number in np.ravel(ids)]
    return {
        number: _crossing(np.asarray(quad, float).reshape(4, 2))
        for number, quad in zip(numbers, quads, strict=True)
        if numbers.count(number) == 1
    }


def locate_camera(points: PointRows, pixels: PixelRows, lens: Intrinsics) -> tuple[CameraPose, Float[np.ndarray, " n"]]:
    """Return the camera's place, from points in the base frame and where they are seen, and the distance [m] of each point
    from its ray. Raise UserError if they are too few or lie on a line."""
    points, pixels = np.ascontiguousarray(points, float), np.ascontiguousarray(pixels, float)
    if len(points) < LEAST_POINTS:
        raise UserError(
            f"{len(points)} known points are seen and {LEAST_POINTS} are needed; put more markers in the view"
        )
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if not spread[1] >= 0.1 * spread[0]:
        raise UserError("the known points lie nearly on a line; spread them over the table")
    starts = cv2.solvePnPGeneric(points, pixels, lens.matrix, lens.distortion, flags=cv2.SOLVEPNP_SQPNP)
    fits = []
    for rotation, position in zip(starts[1], starts[2], strict=True):
        rotation, position = cv2.solvePnPRefineLM(points, pixels, lens.matrix, lens.distortion, rotation, position)
        seen = RigidTransform.from_components(np.ravel(position), Rotation.from_rotvec(np.ravel(rotation)))
        fits.append((_ray_distances(seen.apply(points), pixels, lens), seen))
    if not fits:
        raise UserError("no place of the camera explains what it sees; check the positions of the markers in the file")
    distances, seen = min(fits, key=lambda fit: float(np.sum(fit[0] ** 2)))
    return CameraPose(seen.inv(), float(np.sqrt(np.mean(distances**2))), len(points)), distances


def _crossing(corners: Corners) -> Pixel:
    """Return where the diagonals meet."""
    a, b, c, d = corners
    share = np.linalg.solve(np.stack([c - a, b - d], axis=1), b - a)[0]
    return a + share * (c - a)


def _ray_distances(points: PointRows, pixels: PixelRows, lens: Intrinsics) -> Float[np.ndarray, " n"]:
    """Return how far points of the camera's frame are from the rays on which they are seen, m."""
    flat = cv2.undistortPoints(pixels.reshape(-1, 1, 2), lens.matrix, lens.distortion).reshape(-1, 2)
    rays = np.column_stack([flat, np.ones(len(flat))])
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    return np.linalg.norm(points - np.sum(points * rays, axis=1, keepdims=True) * rays, axis=1)
