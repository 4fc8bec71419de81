"""Does perception say what is wrong with what it sees, and nothing where nothing is wrong? Rendered layouts of the robot
cell, boxes turned at random, on the tables and stacked, at the realistic twin's errors and at 1.5 times these; then with a
camera that was moved since its calibration. Nothing was measured with a real camera.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
from collections import Counter
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import mujoco
import numpy as np
from rich.progress import track

from benchmarks._report import report
from benchmarks.deploy_perception import Still, arrange
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import CAMERA, build_scene
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.sensor import Sensor
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks import load_task

IMAGES = 8  # of each layout
REAL = Realism()
UP, DEGREE = 0.005, float(np.radians(1.0))  # m and rad
CELLS = {
    "realistic": REAL,
    "realistic, 1.5 times": REAL.scaled(1.5),
    "blur 1.0 px, noise and calibration 1.5 times": dataclasses.replace(REAL.scaled(1.5), blur=1.0),
    "blur 1.5 px, noise and calibration 1.5 times": dataclasses.replace(REAL.scaled(1.5), blur=1.5),
    "blur 3 px": dataclasses.replace(REAL, blur=3.0),
    "camera 5 mm up": dataclasses.replace(REAL, camera_moved=(0.0, 0.0, UP)),
    "camera 5 mm down": dataclasses.replace(REAL, camera_moved=(0.0, 0.0, -UP)),
    "camera turned by 1 degree about x": dataclasses.replace(REAL, camera_turned=(DEGREE, 0.0, 0.0)),
    "camera turned by 1 degree about y": dataclasses.replace(REAL, camera_turned=(0.0, DEGREE, 0.0)),
    "camera turned by 1 degree about z": dataclasses.replace(REAL, camera_turned=(0.0, 0.0, DEGREE)),
    "camera 5 mm aside": dataclasses.replace(REAL, camera_moved=(0.0, UP, 0.0)),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="yumi_stack")
    parser.add_argument("--layouts", type=int, default=20)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    task, rows = load_task(arguments.task), []
    for name, realism in CELLS.items():
        perfect = dataclasses.replace(Realism.perfect(), width=realism.width, height=realism.height)
        model = build_scene(YUMI, task, 0, realism).model
        data, rng, said = mujoco.MjData(model), np.random.default_rng(0), Counter()
        camera = Still(RenderedCamera(model, lambda data=data: (0.0, data.qpos), CAMERA, realism=perfect))
        camera.sensor = Sensor(realism)
        for seed in track(range(arguments.layouts), description=name):
            scene = build_scene(YUMI, task, seed, realism)
            arrange(task, model, data, scene.cell.qpos, rng)
            perception = Perception(task, camera, scene.calibrated)
            for _ in range(IMAGES):
                perception.update()
            said.update({kind(finding.text) for finding in perception.findings(perception.image)})
        camera.close()
        rows.append({"cell": name, "layouts": arguments.layouts} | {key: said[key] for key in KINDS})
    title = f"in how many of {arguments.layouts} layouts of {task.name} it was said that ..."
    report("deploy_findings", title, rows, out=arguments.out, images=IMAGES)


KINDS = {"the camera moved": "the camera has moved", "the picture is soft": "too soft", "anything else": ""}


def kind(text: str) -> str:
    return next(name for name, part in KINDS.items() if part in text)


if __name__ == "__main__":
    main()
