"""Which marker is where: an ArUco marker of its own on every face of every cuboid, on the top of every cylinder, and several
on the plate of every kit.

Ids follow from the task alone, so that a printed sheet, the twin's textures and the detector cannot disagree.
"""

from __future__ import annotations

import dataclasses
import functools

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.arrays import Matrix3, PointRows
from bt_jax.deploy.perception.kit_stickers import kit_stickers
from bt_jax.tasks import Object, Task

__all__ = ["DICTIONARIES", "FACES", "MODULES", "Marker", "marker_dictionary", "marker_image", "square", "task_markers"]

# 4 x 4 bits: the largest modules for a given size, which is what counts with small markers. Each holds those before it.
DICTIONARIES = {50: "DICT_4X4_50", 100: "DICT_4X4_100", 250: "DICT_4X4_250"}
MODULES = 6  # across a marker: 4 bits and the black border
# Modules of bright margin around it: more on a kit, whose plate is dark, and on a disc, which cuts the corners off.
QUIET = {"cuboid": 1, "cylinder": 2, "kit": 2}
NARROWEST = 0.01  # m: a face that is narrower has no marker
TOP = "front"  # the face of a cylinder that has one

# Name of the face in a MuJoCo cube texture -> axes of the marker (right, up) in the box's frame.
FACES = {
    "right": ((0, 0, -1), (0, 1, 0)),
    "left": ((0, 0, 1), (0, 1, 0)),
    "up": ((1, 0, 0), (0, 0, -1)),
    "down": ((1, 0, 0), (0, 0, 1)),
    "front": ((1, 0, 0), (0, 1, 0)),
    "back": ((-1, 0, 0), (0, 1, 0)),
}


@dataclasses.dataclass(frozen=True)
class Marker:
    """A square marker on a body. `size` is the edge of its black square [m]; `pose` is the marker's frame in the body's:
    origin at its centre, x to the right and y up as printed, z out of the surface. `quiet` is the bright margin around it,
    in modules (sixths of `size`)."""

    id: int
    body: str
    face: str
    size: float
    pose: RigidTransform
    quiet: int

    @functools.cached_property
    def axes(self) -> Matrix3:
        """Right, up and out of the surface, as columns, in the body's frame."""
        return self.pose.rotation.as_matrix()

    @functools.cached_property
    def corners(self) -> Float[np.ndarray, "4 3"]:
        """In the body's frame [m], clockwise from the top left, the order of OpenCV."""
        return self.place(square(self.size)[:, :2])

    def place(self, flat: Float[np.ndarray, "n 2"]) -> PointRows:
        """Return points of the marker's plane [m] in the body's frame."""
        return flat @ self.axes[:, :2].T + self.pose.translation

    @property
    def sticker(self) -> float:
        """Edge of the square that is bright around the marker, m; on a cylinder, its diameter."""
        return self.size * (MODULES + 2 * self.quiet) / MODULES


@functools.lru_cache(maxsize=16)
def task_markers(task: Task) -> tuple[Marker, ...]:
    """Return all markers of a task: those of the objects in its order, then those of the kits.

    Raise UserError if there are more than the largest dictionary has, or if an object has no room for one.
    """
    places = [place for thing in task.objects for place in _on_object(thing)]
    places += [place for kit in task.kits for place in _on_kit(task, kit.name)]
    if len(places) > max(DICTIONARIES):
        raise UserError(
            f"the objects and kits of task {task.name} need {len(places)} markers, and there are {max(DICTIONARIES)}; "
            "use fewer objects"
        )
    return tuple(dataclasses.replace(marker, id=number) for number, marker in enumerate(places))


def square(size: float) -> Float[np.ndarray, "4 3"]:
    """Return the corners of a square around the origin, clockwise from the top left with y up."""
    half = size / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])


def marker_dictionary(count: int = 50) -> cv2.aruco.Dictionary:
    """Return the smallest dictionary with `count` markers; the first ones of all are the same."""
    name = next(name for size, name in DICTIONARIES.items() if size >= count)
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def marker_image(number: int, quiet: float | int, module: int) -> UInt8[np.ndarray, "edge edge"]:
    """Return a marker in its bright margin, 0 black and 255 bright; its edge is (6 + 2 * quiet) * `module` [px]."""
    black = cv2.aruco.generateImageMarker(marker_dictionary(number + 1), number, MODULES * module)
    return np.pad(black, round(quiet * module), constant_values=255)


def _on_object(thing: Object) -> list[Marker]:
    """Return the markers of an object, as large as its faces allow and not numbered yet. Raise UserError if all are too
    narrow."""
    faces = (TOP,) if thing.shape == "cylinder" else tuple(FACES)
    markers = [marker for face in faces if (marker := _on_face(thing, face)).sticker >= NARROWEST]
    if not markers:
        raise UserError(f"{thing.name} is too small for a marker; use objects with a face {1000 * NARROWEST:g} mm wide")
    return markers


def _on_face(thing: Object, face: str) -> Marker:
    right, up = np.array(FACES[face], float)
    axes = np.stack([right, up, np.cross(right, up)], axis=1)
    wide, high, deep = np.abs(axes.T) @ np.array(thing.size)
    pose = RigidTransform.from_components(axes[:, 2] * deep / 2, Rotation.from_matrix(axes))
    quiet = QUIET[thing.shape]
    return Marker(0, thing.name, face, float(min(wide, high)) * MODULES / (MODULES + 2 * quiet), pose, quiet)


def _on_kit(task: Task, name: str) -> list[Marker]:
    """Return the markers of a kit, not numbered yet."""
    kit, quiet = task.kits[task.kit_names.index(name)], QUIET["kit"]
    return [
        Marker(
            0,
            name,
            sticker.name,
            sticker.edge * MODULES / (MODULES + 2 * quiet),
            RigidTransform.from_translation([*sticker.middle, kit.plate]),
            quiet,
        )
        for sticker in kit_stickers(task, kit)
    ]
