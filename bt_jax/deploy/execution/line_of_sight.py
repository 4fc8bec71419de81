"""Are the arms between the camera and what it should see?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.collisions import CollisionModel
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.shapes import Box
from bt_jax.tasks import Task

__all__ = ["LineOfSight"]


class LineOfSight:
    """Of a camera, past the arms of a robot. Each hand counts as if it held the task's largest box."""

    def __init__(self, robot: RobotModel, task: Task) -> None:
        self._model, here = CollisionModel(robot), RigidTransform.identity()
        held = Box((0, 0, 0), (max(box.edge for box in task.objects),) * 3)
        for arm in robot.arms:
            for shape in arm.shapes:
                name = arm.link_name(shape.link)
                self._model.add(name, name, here, shape.solid)
            self._model.add(f"{arm.name} hand's box", f"{arm.name}_tcp", here, held)
        self._model.watch([])

    def blocked(self, joints: Mapping[str, Joints], sight: Sequence[Sequence[float]], margin: float) -> bool:
        """May arms with these joints hide one of the places of `sight` from the first of them, the camera's, or come as near
        to a line between them as `margin`? In the base frame, m."""
        self._model.move(joints, {})
        eye, *places = (np.array(place, float) for place in sight)
        return any(self._model.is_near_line(eye, place, margin) for place in places)
