"""Which markers does the camera see, as far as objects and kits hide them?"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.arrays import PointRows
from bt_jax.deploy.perception.markers import Marker
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Task

__all__ = ["Sight"]

SAMPLES = 7  # points across a sticker
AROUND = 0.004  # m by which bodies may be larger than they are, for errors of their poses


class Sight:
    """Lines of sight from a camera at `eye` in the base frame [m]."""

    def __init__(self, task: Task, eye: Point) -> None:
        self._task, self._eye = task, eye

    def hidden(
        self,
        marker: Marker,
        body: RigidTransform,
        poses: Mapping[str, RigidTransform],
        *,
        edge: float | None = None,
        around: float = AROUND,
    ) -> bool:
        """Is a marker on a body hidden, or a part of it, by another body or by a kit's walls? `edge` is that of the square
        that is looked at [m], by default the whole sticker; what hides it counts as larger by `around` [m]."""
        half = np.linspace(-0.5, 0.5, SAMPLES) * (marker.sticker if edge is None else edge)
        points = body.apply(marker.place(np.array([[x, y] for x in half for y in half])))
        return any(
            _meets(self._eye, points, pose, half_sizes) for pose, half_sizes in self._solids(poses, marker.body, around)
        )

    def _solids(
        self, poses: Mapping[str, RigidTransform], own: str, around: float
    ) -> Iterator[tuple[RigidTransform, Float[np.ndarray, " 3"]]]:
        """Yield the cuboids that may hide a marker of the body `own`, those around cylinders included: their poses and half
        their edges [m]."""
        for thing in self._task.objects:
            if thing.name in poses and thing.name != own:
                yield poses[thing.name], np.array(thing.size) / 2 + around
        for kit in self._task.kits:
            if kit.name in poses:
                for middle, half in kit.walls():
                    wall = RigidTransform.from_translation([*middle, kit.plate + kit.wall_height / 2])
                    yield poses[kit.name] * wall, np.array([*half, kit.wall_height / 2]) + around


def _meets(eye: Point, points: PointRows, pose: RigidTransform, halves: Float[np.ndarray, " 3"]) -> bool:
    """Does a straight line from the eye to any of the points pass through a cuboid? (Kay and Kajiya's slabs, 1986.)"""
    back = pose.inv()
    start, ends = back.apply(eye), back.apply(points)
    rays = ends - start
    rays = np.where(np.abs(rays) < 1e-12, 1e-12, rays)
    first, second = (-halves - start) / rays, (halves - start) / rays
    enter, leave = np.minimum(first, second).max(axis=1), np.maximum(first, second).min(axis=1)
    return bool(np.any((enter <= leave) & (leave > 0) & (enter < 1)))
