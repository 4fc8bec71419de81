"""Which markers a camera must see whole where objects and kits are, if nothing unknown is in the way."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.markers import task_markers
from bt_jax.deploy.perception.sight import Sight
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Task

__all__ = ["visible_markers"]

LEAST = math.sin(math.radians(28))  # of the angle between view and surface: a marker seen more flatly may be unreadable
PART = 0.95  # of a marker's edge that is looked at


def visible_markers(
    task: Task, poses: Mapping[str, RigidTransform], camera: RigidTransform, *, of: Collection[str] | None = None
) -> dict[str, dict[int, Point]]:
    """Return for each body, or those named by `of`, the markers that nothing known hides: neither another object nor a wall
    of a kit, not even in part; by their ids, with the places of their centres. Poses, also the camera's, are in the base
    frame [m]."""
    sight = Sight(task, camera.translation)
    found: dict[str, dict[int, Point]] = {name: {} for name in (poses if of is None else of)}
    for marker in task_markers(task):
        if marker.body not in found:
            continue
        place = poses[marker.body] * marker.pose
        line = camera.translation - place.translation
        facing = float(place.rotation.as_matrix()[:, 2] @ line) >= LEAST * float(np.linalg.norm(line))
        if facing and not sight.hidden(marker, poses[marker.body], poses, edge=PART * marker.size, around=0.0):
            found[marker.body][marker.id] = place.translation
    return found
