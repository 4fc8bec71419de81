"""How two frames differ, which way up a box lies, and what stands on what.

Poses are in one frame whose z points up [m]. A cube has no top of its own: whichever face is up, "on top of it" is against
gravity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import geometry
from bt_jax.behaviors.geometry import GEOMETRY, rests_on
from bt_jax.behaviors.pose import Pose
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Kit, Object, Table, Task

__all__ = [
    "distance_between",
    "heading",
    "is_over_kit",
    "lean",
    "level",
    "plain",
    "stands_on",
    "stood",
    "table_under",
    "turn_between",
]


def distance_between(a: RigidTransform, b: RigidTransform) -> float:
    """Return how far the origins of two frames are apart, m."""
    return math.dist(a.translation, b.translation)


def turn_between(a: RigidTransform, b: RigidTransform) -> float:
    """Return the angle of the rotation from the axes of one frame to those of another, rad."""
    return float((a.rotation.inv() * b.rotation).magnitude())


def lean(pose: RigidTransform, thing: Object | None = None) -> float:
    """Return the angle between the vertical and the axis of the body that is nearest to it, rad; of a cylinder, its own."""
    up = np.abs(pose.rotation.as_matrix()[2])
    return math.acos(min(1.0, float(up[2] if thing is not None and thing.shape == "cylinder" else up.max())))


def level(pose: RigidTransform) -> RigidTransform:
    """Return a cube's frame with that axis as z which points up most nearly. Frames of upright cubes stay; one that was
    tipped over, about an axis of its own, keeps its yaw; one that is upside down is turned about its x axis."""
    up = pose.rotation.as_matrix()[2]
    axis = int(np.argmax(np.abs(up)))
    if axis == 2:
        turn = Rotation.identity() if up[2] > 0 else Rotation.from_euler("x", math.pi)
    else:
        new = np.sign(up[axis]) * np.eye(3)[axis]
        turn = Rotation.from_rotvec(math.pi / 2 * np.cross([0, 0, 1], new))
    return RigidTransform.from_components(pose.translation, pose.rotation * turn)


def stood(thing: Object, pose: RigidTransform) -> RigidTransform:
    """Return an object's frame with z upwards if it stands on its foot or its top; a cube's whichever face it lies on."""
    upside_down = pose.rotation.as_matrix()[2, 2] < -GEOMETRY.upright
    return level(pose) if thing.is_cube or upside_down else pose


def heading(rotation: Rotation) -> float:
    """Return the angle of a frame about the vertical, rad."""
    return geometry.heading(plain(RigidTransform.from_rotation(rotation)))


def stands_on(
    task: Task,
    upper: str,
    lower: str,
    poses: Mapping[str, RigidTransform],
    *,
    above_most: float = GEOMETRY.above_most,
) -> bool:
    """Does a box stand over another one, close enough to rest on it? `above_most` as for `rests_on`."""
    return upper != lower and rests_on(
        task.thing(upper), plain(poses[upper]), task.thing(lower), plain(poses[lower]), above_most=above_most
    )


def plain(pose: RigidTransform) -> Pose:
    """Return a pose as `behaviors.geometry` takes it."""
    return Pose.of([*pose.translation, *pose.rotation.as_quat(scalar_first=True)])


def is_over_kit(kit: Kit, pose: RigidTransform, place: Point) -> bool:
    """Is a place over the plate of a kit at `pose`, or below it?"""
    return bool(np.all(np.abs(pose.inv().apply(place)[:2]) < kit.half))


def table_under(task: Task, place: Point) -> Table | None:
    """Return the table over which a place of the world lies, None if there is none under it."""
    for table in task.tables:
        if np.all(np.abs(place[:2] - table.position[:2]) <= np.array(table.size[:2]) / 2):
            return table
    return None
