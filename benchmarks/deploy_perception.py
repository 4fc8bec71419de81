"""How well does the camera see? Rendered layouts of the robot cell, boxes turned at random, on the tables and stacked:
errors of every box and of the kit by how many of their markers were used, wrong identities and flips, and the processor
time of an image, at several blurs of the lens and two sizes of the images. Nothing was measured with a real camera.

A body counts as visible when a face that the camera sees at more than VISIBLE degrees is not hidden, not even in part.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import os
from pathlib import Path
from time import process_time

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from rich.progress import track
from scipy.spatial.transform import RigidTransform, Rotation

from benchmarks._report import report
from bt_jax.deploy.perception.camera import CameraFrame
from bt_jax.deploy.perception.markers import Marker, task_markers
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.tracker import TrackerSettings
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import CAMERA, build_scene
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.deploy.twin.sensor import Sensor
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks import Task, load_task

VISIBLE = 20.0  # degrees
GROSS_ANGLE, GROSS_DISTANCE = 10.0, 0.02  # degrees and m: a pose this wrong is a flip or another body


class Still:
    """A camera in front of a cell that stands still; `sensor` makes of its images what a real one would."""

    def __init__(self, camera: RenderedCamera) -> None:
        self.camera, self.sensor, self.count = camera, Sensor(Realism.perfect()), 0

    def read(self) -> CameraFrame:
        frame = self.camera.read()
        self.count += 1
        return dataclasses.replace(frame, image=self.sensor(frame.image), time=float(self.count))

    def close(self) -> None:
        self.camera.close()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="yumi_stack")
    parser.add_argument("--layouts", type=int, default=100)
    parser.add_argument("--noise", type=float, default=2.5, help="standard deviation of the image noise, grey levels")
    parser.add_argument("--blur", type=float, nargs="+", default=[0.0, 0.7, 1.0, 1.5], help="of the lens, px")
    parser.add_argument("--width", type=int, nargs="+", default=[640, 1280], help="of the images, px; 4 to 3")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    task = load_task(arguments.task)
    model = build_scene(YUMI, task, 0).model
    data = mujoco.MjData(model)
    rows = []
    for width in arguments.width:
        perfect = dataclasses.replace(Realism.perfect(), width=width, height=width * 3 // 4)
        camera = Still(RenderedCamera(model, lambda: (0.0, data.qpos), CAMERA, realism=perfect))
        sensors = {
            blur: Sensor(dataclasses.replace(perfect, blur=blur, noise=arguments.noise)) for blur in arguments.blur
        }
        records, seconds = {blur: [] for blur in sensors}, {blur: [] for blur in sensors}
        rng = np.random.default_rng(0)
        for seed in track(range(arguments.layouts), description=f"layouts, {width} px"):
            arrange(task, model, data, build_scene(YUMI, task, seed).cell.qpos, rng)
            bodies = truth(task, model, data)
            for blur, camera.sensor in sensors.items():
                perception = Perception(task, camera, cell_camera(task).pose, TrackerSettings(frames=1))
                frame = camera.read()
                began = process_time()
                perception.detector.look(frame.image, frame.matrix, frame.distortion)
                seconds[blur].append(process_time() - began)
                perception.update()
                records[blur] += compare(bodies, perception)
        camera.close()
        for blur, found in records.items():
            size = {"image": f"{width} x {width * 3 // 4}", "blur px": blur}
            boxes = [record for record in found if record["body"] != task.kits[0].name]
            groups = {"boxes": boxes, "kit": [record for record in found if record["body"] == task.kits[0].name]}
            groups["boxes, 1 marker"] = [record for record in boxes if record["markers"] == 1]
            ms = 1000 * float(np.median(seconds[blur]))
            rows += [size | summary(name, group) | {"CPU ms an image": ms} for name, group in groups.items()]
    report(
        "deploy_perception",
        f"{arguments.layouts} layouts of {task.name}, image noise {arguments.noise:g} grey levels",
        rows,
        out=arguments.out,
        layouts=arguments.layouts,
        noise=arguments.noise,
    )


def arrange(task: Task, model, data, qpos: np.ndarray, rng: np.random.Generator) -> None:
    """A layout of the task, each box on a face at random; every other time some boxes stand on one another or in the kit."""
    data.qpos[:] = qpos
    stacked = rng.random() < 0.5
    top = None
    for box in task.objects:
        at = model.jnt_qposadr[model.body(box.name).jntadr[0]]
        turn = Rotation.from_quat(data.qpos[at + 3 : at + 7], scalar_first=True)
        face = Rotation.from_euler("xyz", rng.integers(0, 4, 3) * np.pi / 2)
        data.qpos[at + 3 : at + 7] = (turn * face).as_quat(scalar_first=True)
        if stacked and rng.random() < 0.6:
            kit = model.body(task.kits[0].name).pos
            base = np.array([*kit[:2], kit[2] + task.kits[0].thickness / 2 - box.edge / 2]) if top is None else top
            data.qpos[at : at + 3] = top = base + np.array([0, 0, box.edge])
    mujoco.mj_forward(model, data)


def truth(task: Task, model, data) -> dict[str, tuple[RigidTransform, bool]]:
    """Where every body is, and whether it is to be seen."""
    bodies = {}
    for body in (*task.object_names, task.kits[0].name):
        pose = body_pose(data, body)
        markers = [marker for marker in task_markers(task) if marker.body == body]
        bodies[body] = pose, any(unhidden(model, data, pose, marker) for marker in markers)
    return bodies


def compare(bodies: dict[str, tuple[RigidTransform, bool]], perception: Perception) -> list[dict]:
    """A record for every body: is it to be seen, was it found and believed, and how wrong."""
    believed = perception.tracker.poses(perception.image)
    used = {detection.body: detection for detection in perception.detections}
    records = []
    for body, (pose, visible) in bodies.items():
        record = {"body": body, "visible": visible, "found": body in believed, "markers": 0}
        if body in believed:
            error = pose.inv() * believed[body]
            record |= {
                "markers": len(used[body].markers),
                "mm": 1000 * float(np.linalg.norm(believed[body].translation - pose.translation)),
                "deg": math.degrees(error.rotation.magnitude()),
            }
        records.append(record)
    return records


def unhidden(model, data, body: RigidTransform, marker: Marker) -> bool:
    """Does the camera see the marker and its margin whole, and not too flatly?"""
    eye = data.cam(CAMERA).xpos
    face = body * marker.pose
    outward = face.rotation.as_matrix()[:, 2]
    sight = (eye - face.translation) / np.linalg.norm(eye - face.translation)
    if outward @ sight < math.sin(math.radians(VISIBLE)):
        return False
    half = np.linspace(-0.49, 0.49, 7) * marker.sticker
    points = face.apply([[x, y, 1e-3] for x in half for y in half])
    hit = np.zeros(1, np.int32)
    for point in points:
        ray = eye - point
        distance = mujoco.mj_ray(model, data, point, ray / np.linalg.norm(ray), None, 1, -1, hit, None)
        if 0 <= distance < np.linalg.norm(ray):
            return False
    return True


def body_pose(data, body: str) -> RigidTransform:
    found = data.body(body)
    return RigidTransform.from_components(found.xpos, Rotation.from_quat(found.xquat, scalar_first=True))


def summary(name: str, records: list[dict]) -> dict:
    found = [record for record in records if record["found"]]
    seen = [record for record in found if record["visible"]]
    mm, deg = (np.array([record[key] for record in seen] or [math.nan]) for key in ("mm", "deg"))
    gross = [r for r in found if r["deg"] > GROSS_ANGLE or r["mm"] > 1000 * GROSS_DISTANCE]
    return {
        "body": name,
        "all": len(records),
        "visible": sum(record["visible"] for record in records),
        "of them found": len(seen),
        "found though partly hidden": len(found) - len(seen),
        "mm median": float(np.median(mm)),
        "mm 95 %": float(np.percentile(mm, 95)),
        "mm worst": float(mm.max()),
        "deg median": float(np.median(deg)),
        "deg 95 %": float(np.percentile(deg, 95)),
        "deg worst": float(deg.max()),
        "wrong or flipped": len(gross),
    }


if __name__ == "__main__":
    main()
