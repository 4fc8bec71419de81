"""Is the camera still where it was when it was calibrated? What lies on a table lies level, at a height that is known.

A camera that was shifted upwards, or turned about a horizontal axis, sees everything too high or too low, or at a slant. One
that was only shifted sideways, or turned about the vertical, sees everything as it should be, elsewhere: nothing in the cell
tells that, since objects and kits may stand anywhere on the tables.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.pose_geometry import is_over_kit, stands_on, stood, table_under
from bt_jax.tasks import Task

__all__ = ["CameraShift", "camera_shift"]

HEIGHT = 0.0032  # m by which things must seem too high or too low; a calibration as in the twin is wrong by up to 2 mm
TILT = math.radians(0.5)  # by which they must seem to slant
ALIKE = 0.5  # of these limits: within it things err alike, as they do if the camera is to blame
AWAY = 0.03  # m from its height on a table: such a box lies on nothing that is known
UPRIGHT = math.radians(6)  # a box that is tilted by more leans on something


@dataclasses.dataclass(frozen=True)
class CameraShift:
    """How far what is seen is from where it must be: `height` [m], positive if too high, and `tilt` [rad], each 0 if it
    is not to be noticed."""

    height: float
    tilt: float

    def __str__(self) -> str:
        parts = [f"seem {1000 * abs(self.height):.0f} mm too {'high' if self.height > 0 else 'low'}"] * bool(
            self.height
        )
        parts += [f"slant by {math.degrees(self.tilt):.1f} degrees"] * bool(self.tilt)
        return f"the camera has moved since it was calibrated (things {' and '.join(parts)}): calibrate again"


def camera_shift(task: Task, poses: Mapping[str, RigidTransform]) -> CameraShift | None:
    """Return by how much the camera must have moved since its calibration, from what it sees of objects and kits in the base
    frame; None if nothing tells so. Most of the things that lie on a table, and two at least, must err alike: one that is
    held, or lies on something unknown, proves nothing."""
    lying = _lying(task, poses)
    height = _common([[error] for error, _ in lying], HEIGHT)
    tilt = _common([up for _, up in lying], TILT)
    if height is None and tilt is None:
        return None
    return CameraShift(
        0.0 if height is None else float(height[0]), 0.0 if tilt is None else float(np.linalg.norm(tilt))
    )


def _lying(task: Task, poses: Mapping[str, RigidTransform]) -> list[tuple[float, Float[np.ndarray, " 2"]]]:
    """Return, for all that lies on a table or a kit, how much too high it is [m] and the slope of its top."""
    finite = {name: pose for name, pose in poses.items() if np.isfinite(pose.as_matrix()).all()}
    base, found = np.array(task.robot_position), []
    kits = [(kit, finite[kit.name]) for kit in task.kits if kit.name in finite]
    for kit, pose in kits:
        if (table := table_under(task, pose.translation + base)) is not None:
            error = pose.translation[2] + base[2] - table.top - kit.thickness / 2
            found.append((float(error), pose.rotation.as_matrix()[:2, 2]))
    boxes = {box.name: finite[box.name] for box in task.objects if box.name in finite}
    for box in task.objects:
        if box.name not in boxes:
            continue
        pose = stood(box, boxes[box.name])
        on_another = any(stands_on(task, box.name, other, boxes, above_most=math.inf) for other in boxes)
        table = table_under(task, pose.translation + base)
        if _slope(pose) > UPRIGHT or on_another or table is None:
            continue
        under = [kit.thickness for kit, place in kits if is_over_kit(kit, place, pose.translation)]
        floor = table.top + max(under, default=0.0)
        error = float(pose.translation[2] + base[2] - floor - box.height / 2)
        if abs(error) < AWAY:
            found.append((error, pose.rotation.as_matrix()[:2, 2]))
    return found


def _slope(pose: RigidTransform) -> float:
    """Return the angle between the vertical and the z axis of a frame, rad."""
    return math.acos(float(np.clip(pose.rotation.as_matrix()[2, 2], -1.0, 1.0)))


def _common(
    errors: Sequence[Sequence[float] | Float[np.ndarray, " k"]], limit: float
) -> Float[np.ndarray, " k"] | None:
    """Return the mean of the errors that most things have alike, two at least, if it exceeds the limit."""
    rows = np.array(errors, float)
    if len(rows) < 2:
        return None
    near = np.linalg.norm(rows[:, None] - rows[None], axis=2) <= ALIKE * limit
    best = near[int(np.argmax(near.sum(axis=1)))]
    mean = rows[best].mean(axis=0)
    most = best.sum() >= 2 and 2 * best.sum() > len(rows)
    return mean if most and float(np.linalg.norm(mean)) > limit else None
