"""Where the tool must be to grasp an object or to set one down: from above, its fingers along a pair of parallel faces.

A cube may lie on any of its faces. All other objects stand on their foot.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.planning.pose_geometry import heading
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Object

__all__ = [
    "carried_pose",
    "grasp_poses",
    "grip_width",
    "grip_widths",
    "put_poses",
    "raised",
    "release_width",
    "yaw_of",
]

DOWN = Rotation.from_euler("x", np.pi)  # z of the tool towards the floor
QUARTERS = np.arange(4) * np.pi / 2
AROUND = np.arange(8) * np.pi / 4  # directions from which a cylinder is grasped
DEEP = 0.03  # m below the top of a tall object that the TCP goes
LEAST = 0.001  # m below the top of a flat one that it goes, however high it should stay
ASIDE = 0.012  # m by which fingers open wider than what they let go of: neighbours may be near
WIDER = 0.001  # m by which an object may be wider than the fingers open, as sizes are told


def yaw_of(rotation: Rotation) -> float:
    """Return the angle [rad] about the vertical, in 0..pi/2, of the horizontal edges of a cube that lies on a face."""
    axes = rotation.as_matrix()
    level = axes[:, int(np.argmin(np.abs(axes[2])))]
    return float(np.arctan2(level[1], level[0]) % (np.pi / 2))


def grasp_poses(box: RigidTransform, thing: Object, opening: float, least: float = 0.0) -> list[RigidTransform]:
    """Return the poses of the TCP from which an object at `box` can be grasped from above by fingers that open as wide as
    `opening` [m], the TCP as high above its foot as `least` [m] if it is as high as that; all in the base frame. There are
    none for one that lies on its side, except a cube."""
    if not thing.is_cube and box.rotation.as_matrix()[2, 2] < math.cos(math.pi / 4):
        return []
    yaw, above = _yaw(thing, box.rotation), _grip_height(thing, least)
    place = box.translation + np.array([0.0, 0.0, above])
    poses = [
        RigidTransform.from_components(place, Rotation.from_euler("z", yaw + turn) * DOWN) for turn in _turns(thing)
    ]
    fits = [grip_width(thing, tcp.inv() * box) <= opening + WIDER for tcp in poses]
    return [pose for pose, fit in zip(poses, fits, strict=True) if fit]


def grip_width(thing: Object, held: RigidTransform) -> float:
    """Return how far apart the fingers are that hold an object at `held` in the TCP's frame, m."""
    if thing.shape == "cylinder":
        return thing.size[0]
    return thing.size[int(np.argmax(np.abs(held.rotation.as_matrix()[0])))]


def grip_widths(thing: Object, opening: float) -> tuple[float, ...]:
    """Return how far apart fingers may be that hold an object, m."""
    return tuple(dict.fromkeys(width for width in thing.size[:2] if width <= opening + WIDER))


def release_width(thing: Object, held: RigidTransform, opening: float) -> float:
    """Return how far apart fingers move, `opening` at most, to let go of an object at `held` in the TCP's frame, m."""
    return min(grip_width(thing, held) + ASIDE, opening)


def put_poses(
    position: Point, yaw: float, held: RigidTransform, thing: Object, turn: float | None = None
) -> list[list[RigidTransform]]:
    """Return the poses of the TCP with which an object that is at `held` in its frame has its centre at `position`, in a
    frame with its axes along `yaw` [rad]: turned by `turn` degrees in it if that is given, else along its axes; the better
    poses first, alike ones together."""
    first = yaw - _yaw(thing, DOWN * held.rotation)
    groups = []
    for turns in _put_turns(thing, turn):
        rotations = (Rotation.from_euler("z", first + turn) * DOWN for turn in turns)
        groups.append(
            [RigidTransform.from_components(position - turn.apply(held.translation), turn) for turn in rotations]
        )
    return groups


def carried_pose(tcp: RigidTransform, box: RigidTransform, thing: Object) -> RigidTransform:
    """Return an object in the TCP's frame once the fingers have closed: they centre it and align it with themselves."""
    held = tcp.inv() * box
    rotation = held.rotation
    if thing.shape == "cylinder":
        upright = rotation.apply([0.0, 0.0, 1.0])
        rotation = Rotation.align_vectors([[0.0, 0.0, math.copysign(1.0, upright[2])]], [upright])[0] * rotation
    else:
        nearest = np.round(rotation.as_matrix())  # a cube fits in 24 ways
        if abs(abs(np.linalg.det(nearest)) - 1) < 1e-9:
            rotation = Rotation.from_matrix(nearest)
    return RigidTransform.from_components([0.0, *held.translation[1:]], rotation)


def raised(pose: RigidTransform, height: float) -> RigidTransform:
    """Return the same pose, `height` metres above."""
    return RigidTransform.from_components(pose.translation + np.array([0, 0, height]), pose.rotation)


def _yaw(thing: Object, rotation: Rotation) -> float:
    """Return the angle of an object about the vertical, rad; that of its edges for a cube, which may lie on any face."""
    return yaw_of(rotation) if thing.is_cube else heading(rotation)


def _turns(thing: Object) -> tuple[float, ...]:
    """Return the directions of the fingers about the vertical that an object allows, from its own, rad."""
    return tuple(AROUND if thing.shape == "cylinder" else QUARTERS)


def _put_turns(thing: Object, turn: float | None) -> list[list[float]]:
    """Return the angles about the vertical, rad, at which an object may be put down, from the axes of the frame."""
    if thing.shape == "cylinder":
        return [AROUND.tolist()]
    wanted = math.radians(turn or 0.0)
    if thing.symmetry == 90:
        return [(wanted + QUARTERS).tolist()]
    along = [wanted, wanted + math.pi]
    return [along] if turn is not None else [along, [angle + math.pi / 2 for angle in along]]


def _grip_height(thing: Object, least: float) -> float:
    """Return how far above the centre of an object the TCP is that grasps it, m: at half its height, but no deeper below its
    top than the fingers are long, and `least` above its foot."""
    half = thing.height / 2
    return max(0.0, half - DEEP, min(least - half, half - LEAST))
