"""Which markers a camera must see whole where the boxes and the kit are, if nothing else is in the way."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.arrays import PointRows
from bt_jax.deploy.perception.markers import task_markers
from bt_jax.tasks import Task

__all__ = ["visible_markers"]

LEAST = math.sin(math.radians(28))  # of the angle between view and surface: a marker seen more flatly may be unreadable
PART = 0.95  # of a marker's edge: where its corners are looked at
Block = tuple[RigidTransform, np.ndarray]  # frame and half edges [m]


def visible_markers(task: Task, poses: Mapping[str, RigidTransform], camera: RigidTransform) -> dict[str, set[int]]:
    """Return for each body the ids of the markers that nothing known hides: neither another box nor a wall of the kit, not
    even in part. Poses, also the camera's, are in one frame [m]."""
    eye = camera.translation
    blocks = {name: _blocks(task, name, pose) for name, pose in poses.items()}
    found: dict[str, set[int]] = {name: set() for name in poses}
    for marker in task_markers(task):
        if marker.body not in poses:
            continue
        place = poses[marker.body] * marker.pose
        sight = eye - place.translation
        if place.rotation.as_matrix()[:, 2] @ sight < LEAST * np.linalg.norm(sight):
            continue
        points = poses[marker.body].apply(PART * (marker.corners - marker.pose.translation) + marker.pose.translation)
        others = [block for name, own in blocks.items() for block in own if name != marker.body or len(own) > 1]
        if not any(_hides(block, points, eye) for block in others):
            found[marker.body].add(marker.id)
    return found


def _blocks(task: Task, name: str, pose: RigidTransform) -> Sequence[Block]:
    """Return what a body is made of: a box of one block, the kit of its walls."""
    kit = task.kit
    if name != kit.name:
        return [(pose, np.full(3, task.size(name) / 2))]
    long, thick, high = kit.size / 2, kit.wall_thickness / 2, kit.wall_height / 2
    off, up = long - thick, kit.thickness / 2 + high
    return [
        (
            pose * RigidTransform.from_translation([x * off, y * off, up]),
            np.array([long if y else thick, thick if y else long, high]),
        )
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    ]


def _hides(block: Block, points: PointRows, eye: np.ndarray) -> bool:
    """Is the block between any of the points and the eye?"""
    frame, half = block
    back = frame.inv()
    ends, start = back.apply(points), back.apply(eye)
    along = start - ends
    along = np.where(np.abs(along) < 1e-12, 1e-12, along)
    one, other = (-half - ends) / along, (half - ends) / along
    enter, leave = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
    return bool(np.any((enter < leave) & (leave > 1e-6) & (enter < 1)))
