"""Is the camera still where it was when it was calibrated? What lies on a table lies level, at a height that is known.

A camera that was shifted upwards, or turned about a horizontal axis, sees everything too high or too low, or at a slant. One
that was only shifted sideways, or turned about the vertical, sees everything as it should be, elsewhere: nothing in the cell
tells that, since the boxes and the kit may stand anywhere on the tables.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.pose_geometry import is_over_kit, lean, level, stands_on, table_under
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
    """Return by how much the camera must have moved since its calibration, from what it sees of boxes and kit in the base
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
    """Return, for all that lies on a table or the kit, how much too high it is [m] and the slope of its top."""
    finite = {name: pose for name, pose in poses.items() if np.isfinite(pose.as_matrix()).all()}
    base, kit, found = np.array(task.robot_position), finite.get(task.kit.name), []
    if kit is not None and (table := table_under(task, kit.translation + base)) is not None:
        error = kit.translation[2] + base[2] - table.top - task.kit.thickness / 2
        found.append((float(error), kit.rotation.as_matrix()[:2, 2]))
    boxes = {box.name: finite[box.name] for box in task.objects if box.name in finite}
    for box in task.objects:
        pose = boxes.get(box.name)
        on_another = pose is not None and any(
            stands_on(task, box.name, other, boxes, above_most=math.inf) for other in boxes
        )
        if pose is None or lean(pose) > UPRIGHT or on_another:
            continue
        table = table_under(task, pose.translation + base)
        if table is None:
            continue
        in_kit = kit is not None and is_over_kit(task, kit, pose.translation)
        floor = table.top + (task.kit.thickness if in_kit else 0.0)
        error = float(pose.translation[2] + base[2] - floor - box.edge / 2)
        if abs(error) < AWAY:
            found.append((error, level(pose).rotation.as_matrix()[:2, 2]))
    return found


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
