"""What is wrong with what the camera shows, said in words: a soft picture, a camera that was moved, markers that are there
twice, boxes that lean, and things that hide a marker which nothing known hides. Said once it has lasted a few images."""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Iterator, Mapping
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding
from bt_jax.deploy.perception.camera_check import camera_shift
from bt_jax.deploy.perception.detection import Picture
from bt_jax.deploy.perception.markers import MODULES, Marker, task_markers
from bt_jax.deploy.perception.pose_fit import Gates
from bt_jax.deploy.perception.sight import Sight
from bt_jax.deploy.perception.visibility import visible_markers
from bt_jax.deploy.planning.pose_geometry import lean
from bt_jax.tasks import Task

__all__ = ["TILTED", "Inspection", "InspectionSettings"]

TILTED = math.radians(15)  # from which on a box does not lie on a face


@dataclasses.dataclass(frozen=True)
class InspectionSettings:
    """Something is said once it was so in each of `images` images and for `seconds`, and no longer than `forget` [s] after
    the last. `soft`: the blur, in modules of the markers, from which on they are hard to read. A picture is too
    dark if next to all of it is below the brightness `dark`, of 255, and too bright if the share `bright` of it is as bright
    as can be: light then moves the edges of markers."""

    images: int = 4
    seconds: float = 0.4
    forget: float = 1.0
    soft: float = 0.28
    dark: float = 30.0
    bright: float = 0.5


@dataclasses.dataclass
class _Lasting:
    finding: Finding
    since: float
    last: float
    count: int = 1


class Inspection:
    """Of the pictures of one task's cell, by a camera at `camera_pose` in the base frame."""

    def __init__(self, task: Task, camera_pose: RigidTransform, settings: InspectionSettings | None = None) -> None:
        self.settings = settings or InspectionSettings()
        self._task = task
        self._markers = {marker.id: marker for marker in task_markers(task)}
        self._sight = Sight(task, camera_pose.translation)
        self._camera = camera_pose
        tables = [np.array(table.position) - task.robot_position for table in task.tables]
        distance = np.mean([np.linalg.norm(table - camera_pose.translation) for table in tables])
        smallest = min(marker.size for marker in self._markers.values())
        self._module = smallest / MODULES / float(distance)  # rad, as the camera sees one
        self._lasting: dict[tuple[str, str], _Lasting] = {}
        self._lock = threading.Lock()  # images come in one thread and are asked about in another

    def take(
        self,
        time: float,
        picture: Picture,
        poses: Mapping[str, RigidTransform],
        last: Mapping[str, RigidTransform] = MappingProxyType({}),
    ) -> None:
        """Take in an image of `time` [s], and where boxes and kit are known to be, and were when they were `last`, as
        measured, in the base frame."""
        judged = (*self._judge(picture, poses), *self._missing(picture, last))
        now = {(kind, finding.about): finding for kind, finding in judged}
        with self._lock:
            for key, finding in now.items():
                lasting = self._lasting.get(key)
                if lasting is None:
                    self._lasting[key] = _Lasting(finding, time, time)
                else:
                    lasting.finding, lasting.last, lasting.count = finding, time, lasting.count + 1
            self._lasting = {key: lasting for key, lasting in self._lasting.items() if key in now}

    def findings(self, time: float) -> tuple[Finding, ...]:
        """Return what is wrong as of `time` [s]."""
        limits = self.settings
        with self._lock:
            return tuple(
                lasting.finding
                for lasting in self._lasting.values()
                if lasting.count >= limits.images
                and lasting.last - lasting.since >= limits.seconds
                and time - lasting.last <= limits.forget
            )

    def _judge(self, picture: Picture, poses: Mapping[str, RigidTransform]) -> Iterator[tuple[str, Finding]]:
        blur = self._softness(picture)
        if blur:
            yield "soft", Finding("", f"the picture is too soft (blur of {blur:.1f} px): focus the lens, or clean it")
        if picture.brightest < self.settings.dark:
            yield "light", Finding("", "the picture is too dark: light the cell, or expose longer", stops=True)
        if picture.washed_out > self.settings.bright:
            yield "light", Finding("", "the picture is too bright: expose less", stops=True)
            return
        shift = camera_shift(self._task, poses)
        if shift is not None:
            yield "camera", Finding("", str(shift), stops=True)
        for number in picture.repeated:
            body = self._markers[number].body
            text = f"marker {number} is seen twice: {body}'s markers are on two things"
            yield "twice", Finding(body, text, stops=True)
        for body in picture.apart:
            yield "twice", Finding(body, f"{body}'s markers are seen at two places: they are on two things", stops=True)
        for body, pose in poses.items():
            if body in self._task.object_names and (angle := lean(pose, self._task.thing(body))) > TILTED:
                yield "leans", Finding(body, f"{body} is tilted by {math.degrees(angle):.0f} degrees")
        if all(name in poses for name in self._task.object_names):  # else it may be the one that is missing
            yield from self._covered(picture, poses)

    def _softness(self, picture: Picture) -> float:
        """Return the blur of the picture if it is too soft [px], else 0."""
        if not picture.detections:
            return picture.blur if picture.blur > self.settings.soft * picture.focal * self._module else 0.0
        blur = float(np.median([detection.blur for detection in picture.detections]))
        share = float(np.median([detection.blur / detection.module for detection in picture.detections]))
        return blur if share > self.settings.soft else 0.0

    def _covered(self, picture: Picture, poses: Mapping[str, RigidTransform]) -> Iterator[tuple[str, Finding]]:
        for detection in picture.detections:
            body, known = self._camera * detection.pose, poses.get(detection.body)
            if known is None or math.dist(known.translation, body.translation) > Gates.near:
                continue
            for marker in (self._markers[number] for number in detection.unlike):
                if self._sight.hidden(marker, body, poses):
                    continue
                up = float((body.rotation.as_matrix() @ marker.axes)[2, 2]) > 0.7
                where = "on" if up else "in front of"
                text = f"something unknown is {where} {detection.body}"
                yield f"covered {where}", Finding(detection.body, text, stops=True, sight=self._line(marker, body))

    def _missing(self, picture: Picture, last: Mapping[str, RigidTransform]) -> Iterator[tuple[str, Finding]]:
        """What is not detected, though the camera would see a marker of it if it were still where it was last."""
        detected = {detection.body for detection in picture.detections}
        twice = {*picture.apart, *(self._markers[number].body for number in picture.repeated)}
        absent = set(last) - detected - twice
        for body, places in visible_markers(self._task, last, self._camera, of=absent).items() if absent else ():
            if places:
                line = tuple((float(x), float(y), float(z)) for x, y, z in (self._camera.translation, *places.values()))
                yield "missing", Finding(body, f"{body} is not seen where it was last", sight=line, missing=True)

    def _line(self, marker: Marker, body: RigidTransform) -> tuple[tuple[float, float, float], ...]:
        """Return the camera's place and those of the centre and the corners of a marker's sticker, base frame [m]."""
        half = marker.sticker / 2
        flat = np.array([[0, 0], [-half, -half], [half, -half], [half, half], [-half, half]])
        places = np.vstack([self._camera.translation, body.apply(marker.place(flat))])
        return tuple((float(x), float(y), float(z)) for x, y, z in places)
