"""Which marker is where: an ArUco marker of its own on every face of every box, and one in every corner of the kit's plate.

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
from bt_jax.tasks import Task

__all__ = ["DICTIONARY", "FACES", "MODULES", "Marker", "marker_dictionary", "marker_image", "square", "task_markers"]

DICTIONARY = "DICT_4X4_50"  # the largest modules for a given size: what counts with small markers
MODULES = 6  # across a marker: 4 bits and the black border
QUIET = {"box": 1, "kit": 2}  # modules of bright margin around it; more on the kit, whose plate is dark

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
        """Edge of the square that is bright around the marker, m."""
        return self.size * (MODULES + 2 * self.quiet) / MODULES


@functools.lru_cache(maxsize=16)
def task_markers(task: Task) -> tuple[Marker, ...]:
    """Return all markers of a task: those of the boxes in its order, then those of the kit.

    Raise UserError if the dictionary has too few.
    """
    needed = len(FACES) * len(task.objects) + 4
    available = len(marker_dictionary().bytesList)
    if needed > available:
        most = (available - 4) // len(FACES)
        raise UserError(f"{len(task.objects)} boxes need {needed} markers of {available}; use at most {most} boxes")
    faces = [(box, face) for box in task.objects for face in FACES]
    boxes = [_on_box(number, box.name, box.edge, face) for number, (box, face) in enumerate(faces)]
    return (*boxes, *_on_kit(task, len(boxes)))


def square(size: float) -> Float[np.ndarray, "4 3"]:
    """Return the corners of a square around the origin, clockwise from the top left with y up."""
    half = size / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0]])


def marker_dictionary() -> cv2.aruco.Dictionary:
    """Return the dictionary that all markers are from."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, DICTIONARY))


def marker_image(number: int, quiet: int, module: int) -> UInt8[np.ndarray, "edge edge"]:
    """Return a marker in its bright margin, 0 black and 255 bright; its edge is (6 + 2 * quiet) * `module` [px]."""
    black = cv2.aruco.generateImageMarker(marker_dictionary(), number, MODULES * module)
    return np.pad(black, quiet * module, constant_values=255)


def _on_box(number: int, box: str, edge: float, face: str) -> Marker:
    right, up = np.array(FACES[face], float)
    axes = np.stack([right, up, np.cross(right, up)], axis=1)
    pose = RigidTransform.from_components(axes[:, 2] * edge / 2, Rotation.from_matrix(axes))
    quiet = QUIET["box"]
    return Marker(number, box, face, edge * MODULES / (MODULES + 2 * quiet), pose, quiet)


def _on_kit(task: Task, first: int) -> list[Marker]:
    """Return the markers of the kit: in the corners between the walls, as large as its middle place leaves free."""
    kit = task.kit
    edge = max(box.edge for box in task.objects)
    sticker = 0.9 * (kit.inner[0] - edge / 2)
    if sticker <= 0:
        raise UserError("the kit leaves no room for markers beside a box in its middle; make the kit larger")
    offset, quiet = kit.inner[0] - sticker / 2, QUIET["kit"]
    corners = {"left_front": (-1, -1), "right_front": (1, -1), "left_back": (-1, 1), "right_back": (1, 1)}
    return [
        Marker(
            first + i,
            kit.name,
            face,
            sticker * MODULES / (MODULES + 2 * quiet),
            RigidTransform.from_translation([x * offset, y * offset, kit.thickness / 2]),
            quiet,
        )
        for i, (face, (x, y)) in enumerate(corners.items())
    ]
