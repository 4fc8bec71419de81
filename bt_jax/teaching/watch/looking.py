"""From a camera to sightings."""

from __future__ import annotations

from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.camera import Camera
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.visibility import visible_markers
from bt_jax.tasks import Task
from bt_jax.teaching.watch.sighting import Seen, Sighting

__all__ = ["Looking"]


class Looking:
    """See the bodies of a task through a camera whose frame in the robot's base is `camera_pose` [m]."""

    def __init__(self, task: Task, camera: Camera, camera_pose: RigidTransform) -> None:
        self.task, self.camera = task, camera
        self._perception = Perception(task, camera, camera_pose)

    def look(self) -> Sighting | None:
        """Return what the next image shows, None if there is no newer one yet. Raise CameraError if there will be none."""
        frame, perception = self.camera.read(), self._perception
        if not frame.time > perception.image:
            return None
        perception.take(frame)
        used = {detection.body: detection for detection in perception.detections}
        around = {**perception.tracker.last(), **perception.certain}
        visible = visible_markers(self.task, around, perception.camera_pose)
        bodies = {
            name: Seen(pose, used[name].sigma, bool(visible[name].keys() - set(used[name].markers)))
            for name, pose in perception.certain.items()
        }
        screened = frozenset(name for name, markers in visible.items() if not markers and name not in bodies)
        return Sighting(frame.time, bodies, screened)

    def findings(self) -> tuple[str, ...]:
        """Return what is wrong with the pictures themselves, such as a camera that has moved: not what hands are in front
        of."""
        found = self._perception.findings(self._perception.image)
        return tuple(finding.text for finding in found if not finding.sight)
