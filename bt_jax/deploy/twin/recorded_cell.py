"""Pictures of a run as its log tells it: the arms where they were measured, objects where they were known to be."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.recorded import RecordedMoment, RecordedRun
from bt_jax.deploy.perception.arrays import ColorImage
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.twin.cell import Qpos, build_scene
from bt_jax.deploy.twin.cell_view import CellView
from bt_jax.deploy.twin.person import OFF

__all__ = ["RecordedCell"]


class RecordedCell:
    """Draws the moments of a run. What has never been seen is not shown, and what is out of sight is where it was seen
    last or in the hand that holds it. Raise UserError if nothing can be drawn here."""

    def __init__(self, robot: RobotModel, run: RecordedRun, *, width: int, height: int) -> None:
        task = run.program.task
        self._robot, self._run = robot, run
        self._scene = build_scene(robot, task, run.seed or 0)
        self._base = RigidTransform.from_translation(task.robot_position)
        self._view = CellView(self._scene, width=width, height=height)
        self._poses = list(self._followed())

    def __call__(self, at: int) -> ColorImage:
        """Return a picture of the moment of that number."""
        task, moment, poses = self._run.program.task, self._run.moments[at], self._poses[at]
        for kit in task.kit_names:
            if kit in poses:
                self._view.move(kit, self._base * poses[kit])
        return self._view(self._state(moment, poses))

    def close(self) -> None:
        """Give the OpenGL context back."""
        self._view.close()

    def _state(self, moment: RecordedMoment, poses: dict[str, RigidTransform]) -> Qpos:
        model, qpos = self._scene.model, self._scene.cell.qpos.copy()
        for arm in self._robot.arms:
            for joint, angle in zip(arm.joint_names, moment.joints.get(arm.name, arm.home), strict=True):
                qpos[model.joint(joint).qposadr[0]] = angle
            for finger in arm.finger_names:
                qpos[model.joint(finger).qposadr[0]] = moment.seen.opening.get(arm.name, arm.gripper.opening) / 2
        for name in self._run.program.task.object_names:
            pose = self._base * poses[name] if name in poses else RigidTransform.from_translation([*OFF, 0.0])
            at = model.jnt_qposadr[model.body(name).jntadr[0]]
            qpos[at : at + 7] = [*pose.translation, *pose.rotation.as_quat(scalar_first=True)]
        return qpos

    def _followed(self) -> Iterator[dict[str, RigidTransform]]:
        """Yield for each moment what was known of every object and kit, in the base frame."""
        known: dict[str, RigidTransform] = {}
        for moment in self._run.moments:
            known = known | dict(moment.seen.poses)
            held = moment.seen.holding
            if held is not None and held in known and held not in moment.seen.poses:
                known[held] = self._in_hand(moment, known[held])
            yield known

    def _in_hand(self, moment: RecordedMoment, last: RigidTransform) -> RigidTransform:
        """Return where something is that the hand nearest to its last place holds."""
        tips = [arm.forward(moment.joints.get(arm.name, np.array(arm.home))) for arm in self._robot.arms]
        nearest = min(tips, key=lambda tip: float(np.linalg.norm(tip.translation - last.translation)))
        return RigidTransform.from_components(nearest.translation, last.rotation)
