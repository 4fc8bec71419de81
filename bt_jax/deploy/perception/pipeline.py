"""Camera, detector and tracker as one: from images to poses of objects and kits in the robot's base frame."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding
from bt_jax.deploy.perception.camera import Camera, CameraError, CameraFrame
from bt_jax.deploy.perception.detection import Detection, Detector
from bt_jax.deploy.perception.inspection import TILTED, Inspection
from bt_jax.deploy.perception.markers import task_markers
from bt_jax.deploy.perception.tracker import Tracker, TrackerSettings
from bt_jax.deploy.planning.pose_geometry import lean, stood, turn_between
from bt_jax.tasks import Task

__all__ = ["Perception"]

UPRIGHT = math.radians(4)  # from which tilt on nothing stands on a level surface
LEVEL = 0.3  # least height of an object's centre above the lowest table, in its shortest edges: half of one, if exact
SAME = 0.25  # rad: a doubtful pose this near to what is known is that one


class Perception:
    """`camera_pose` is the camera's frame in the base [m]. `image` is the time of the newest image [s], `lost` why there is
    none, "" if there is. `certain` are the poses that this image alone shows without doubt, in the base frame."""

    def __init__(
        self, task: Task, camera: Camera, camera_pose: RigidTransform, settings: TrackerSettings | None = None
    ) -> None:
        self.camera, self.camera_pose = camera, camera_pose
        table = min(table.top for table in task.tables) - task.robot_position[2]
        self._things = {thing.name: thing for thing in task.objects}
        self._lowest = {name: table + LEVEL * min(thing.size) for name, thing in self._things.items()}
        self.detector = Detector(task_markers(task))
        self.tracker = Tracker(settings)
        self.image = -math.inf
        self.lost = ""
        self.inspection = Inspection(task, camera_pose)
        self.detections: tuple[Detection, ...] = ()
        self.certain: dict[str, RigidTransform] = {}

    def update(self) -> None:
        """Take in the camera's newest image. An old one, or none, changes nothing: what is known goes on ageing."""
        try:
            frame = self.camera.read()
        except CameraError as error:
            self.lost = str(error)
            return
        self.lost = ""
        if frame.time > self.image:
            self.take(frame)

    def take(self, frame: CameraFrame) -> None:
        """Take in an image that is newer than those before."""
        self.image = frame.time
        to_camera = self.camera_pose.inv()
        known = {name: to_camera * pose for name, pose in self.tracker.last().items()}
        picture = self.detector.look(frame.image, frame.matrix, frame.distortion, known)
        self.detections = picture.detections
        sigmas = {detection.body: detection.sigma for detection in self.detections}
        self.certain = dict(self._certain())
        self.tracker.update(frame.time, self.certain, sigmas)
        self.inspection.take(frame.time, picture, self.tracker.poses(frame.time), self.tracker.last())

    def poses(self, time: float) -> dict[str, RigidTransform]:
        """Return the objects and kits whose place is known and fresh at `time` [s], in the base frame. The frame of a cube
        that lies on another face is level: its z axis points up. An object that leans, on no face, is not known."""
        poses = self.tracker.poses(time)
        kits = {name: poses.pop(name) for name in list(poses) if name not in self._things}
        standing = {name: (self._things[name], pose) for name, pose in poses.items()}
        return {
            name: stood(thing, pose) for name, (thing, pose) in standing.items() if lean(pose, thing) <= TILTED
        } | kits

    def findings(self, time: float) -> tuple[Finding, ...]:
        """Return what is wrong with what the pictures show, as of `time` [s]."""
        return self.inspection.findings(time)

    def measured(self) -> dict[str, float]:
        """Return when each object was measured last [s], however long ago."""
        return self.tracker.times()

    def _certain(self) -> Iterator[tuple[str, RigidTransform]]:
        known = self.tracker.poses(self.image)
        for detection in self.detections:
            candidates = [self.camera_pose * detection.pose]
            if detection.alternative is not None:
                candidates.append(self.camera_pose * detection.alternative)
            if len(candidates) > 1 or len(detection.markers) == 1:
                candidates = self._plausible(candidates, detection.body, known.get(detection.body))
            if len(candidates) == 1:
                yield detection.body, candidates[0]

    def _plausible(
        self, candidates: list[RigidTransform], body: str, known: RigidTransform | None
    ) -> list[RigidTransform]:
        """Return those poses of a doubtful measurement that are turned as the known one or, if none is, stand upright and
        not in a table."""
        if known is not None:
            near = [pose for pose in candidates if turn_between(pose, known) < SAME]
            if near:
                return near
        lowest = self._lowest.get(body, -math.inf)
        return [
            pose
            for pose in candidates
            if np.abs(pose.rotation.as_matrix()[2]).max() > math.cos(UPRIGHT) and pose.translation[2] > lowest
        ]
