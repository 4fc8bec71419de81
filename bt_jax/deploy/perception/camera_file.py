"""The files that a calibration reads and writes: camera and its place, places of markers. YAML; lengths are metres, and
the quaternion is xyzw, as its key says."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.yaml_files import read_yaml, to_yaml
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.tasks.bounds import POSITION, Bound, numbers

__all__ = ["load_camera", "load_intrinsics", "load_points", "save_camera"]

Vec3 = tuple[float, float, float]
PIXELS, COUNT = Bound(16.0, 20_000.0, "px"), Bound(1.0, 10_000.0)
BOUNDS: Mapping[str, Bound] = MappingProxyType(
    {  # key, without the numbers of list entries
        "intrinsics.width": PIXELS,
        "intrinsics.height": PIXELS,
        "intrinsics.matrix": Bound(0.0, 1e6, "px"),
        "intrinsics.distortion": Bound(-1e4, 1e4),
        "intrinsics.error_px": Bound(0.0, 100.0, "px"),
        "pose_in_base.position": POSITION,
        "pose_in_base.quaternion_xyzw": Bound(-1.01, 1.01),
        "pose_in_base.residual_m": Bound(0.0, 1.0, "m", ("mm", 0.001)),
        "pose_in_base.points": COUNT,
    }
)
DISTORTIONS = (0, 4, 5, 8, 12, 14)  # numbers of coefficients that OpenCV knows
UNIT = 0.01  # by which the length of a quaternion may differ from 1


@dataclasses.dataclass(frozen=True)
class _Lens:
    width: int
    height: int
    matrix: tuple[Vec3, ...]
    distortion: tuple[float, ...]
    error_px: float


@dataclasses.dataclass(frozen=True)
class _Place:
    position: Vec3
    quaternion_xyzw: tuple[float, float, float, float]
    residual_m: float
    points: int


@dataclasses.dataclass(frozen=True)
class _CameraFile:
    intrinsics: _Lens | None = None
    pose_in_base: _Place | None = None


def save_camera(path: Path, lens: Intrinsics, place: CameraPose | None = None) -> None:
    """Write what `load_camera` reads."""
    data: dict[str, Any] = {
        "intrinsics": {
            "width": lens.width,
            "height": lens.height,
            "matrix": np.asarray(lens.matrix, float).tolist(),
            "distortion": np.ravel(lens.distortion).astype(float).tolist(),
            "error_px": lens.error,
        }
    }
    if place is not None:
        data["pose_in_base"] = {
            "position": place.pose.translation.tolist(),
            "quaternion_xyzw": place.pose.rotation.as_quat().tolist(),
            "residual_m": place.residual,
            "points": place.points,
        }
    write_atomic(path, to_yaml(data))


def load_intrinsics(path: Path) -> Intrinsics:
    """Read the lens alone. Raise UserError if the file has none, or an implausible one."""
    return _lens(path, _read(path, "intrinsics"))


def load_camera(path: Path) -> tuple[Intrinsics, CameraPose]:
    """Read lens and place of a calibrated camera. Raise UserError if one of them is missing or implausible."""
    file = _read(path, "intrinsics")
    lens, place = _lens(path, file), file.pose_in_base
    if place is None:
        raise UserError(f"{path} has no pose_in_base; add it with {_command('base')}")
    if not abs(np.linalg.norm(place.quaternion_xyzw) - 1) <= UNIT:
        raise _wrong(path, "pose_in_base.quaternion_xyzw", "its length is not 1", "base")
    pose = RigidTransform.from_components(place.position, Rotation.from_quat(place.quaternion_xyzw))
    return lens, CameraPose(pose, place.residual_m, place.points)


def load_points(path: Path) -> dict[int, Vec3]:
    """Read the places of markers in the robot's base frame [m], by id. Raise UserError if a line is not `ID: [x, y, z]`."""
    data = read_yaml(path)
    try:
        points = msgspec.convert(data, dict[int, Vec3])
    except msgspec.ValidationError as error:
        raise UserError(
            f"{path} does not list markers ({error}); write one line 'ID: [x, y, z]' for each, in metres"
        ) from error
    for number, point in points.items():
        for value in point:
            if (problem := POSITION.complaint(value)) is not None:
                raise UserError(f"{path}, key {number}: {problem}")
    return points


def _read(path: Path, step: str) -> _CameraFile:
    try:
        file = decode(read_yaml(path), _CameraFile, path)
    except UserError as error:
        raise UserError(f"{error}, or make the file again with {_command(step)}") from error
    for key, name, value in numbers(file, "", ""):
        if name in BOUNDS and (problem := BOUNDS[name].complaint(value)) is not None:
            raise _wrong(path, key, problem, "base" if name.startswith("pose_in_base") else "intrinsics")
    return file


def _lens(path: Path, file: _CameraFile) -> Intrinsics:
    lens = file.intrinsics
    if lens is None:
        raise UserError(f"{path} has no intrinsics; add them with {_command('intrinsics')}")
    matrix, distortion = np.array(lens.matrix, float), np.array(lens.distortion, float)
    pattern = np.array([[1, 0, 1], [0, 1, 1], [0, 0, 1]], bool)
    if matrix.shape != (3, 3) or matrix[2, 2] != 1 or np.any(matrix[~pattern]) or not np.all(np.diag(matrix) > 0):
        raise _wrong(path, "intrinsics.matrix", "it is not of the form [[f, 0, c], [0, f, c], [0, 0, 1]]", "intrinsics")
    if not (matrix[0, 2] <= lens.width and matrix[1, 2] <= lens.height):
        raise _wrong(path, "intrinsics.matrix", "its centre is not in the image", "intrinsics")
    if len(distortion) not in DISTORTIONS:
        raise _wrong(path, "intrinsics.distortion", f"it has {len(distortion)} coefficients", "intrinsics")
    return Intrinsics(matrix, distortion, lens.width, lens.height, lens.error_px)


def _wrong(path: Path, key: str, problem: str, step: str) -> UserError:
    return UserError(f"{path}, key {key}: {problem}; correct it, or make it again with {_command(step)}")


def _command(step: str) -> str:
    return f"python -m bt_jax.deploy calibrate {step}"
