"""A twin that stands in for a real cell: the commands reach it in real time, with sockets, images and all."""

import contextlib
import dataclasses

import numpy as np
import pytest

from bt_jax.deploy.commands import real_cell
from bt_jax.deploy.execution import preflight
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera_file import save_camera
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.network import free_ports
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.tasks import load_task
from tests.helpers.cells import STARVED, skipped_where_starved

TASK = load_task("yumi_stack")
TREE = "move(YellowBox, (0, 0, 0.021), KittingBox)\n"
RARE = 0.2  # seconds between two images that make a machine too busy


class Camera(RenderedCamera):
    """Draws again only when something has moved: everything else runs in real time on the same cores."""

    drawn = None
    asked, longest = None, 0.0  # when it was asked for an image last, and the longest time in between [s]

    def read(self):
        time, qpos = self._state()
        if self.asked is not None:
            self.longest = max(self.longest, float(time) - self.asked)
        self.asked = float(time)
        if self.drawn is None or self._lost or np.abs(qpos - self.drawn[0]).max() > 1e-4:
            self.drawn = qpos, super().read()
        return dataclasses.replace(self.drawn[1], time=float(time))


@contextlib.contextmanager
def connected(folder, monkeypatch, away=0.0):
    """The controller, the cameras that were opened, and the arguments with which a command reaches both.
    The arms begin `away` from home [rad].

    Skips what fails on a machine that is too busy, or cannot render.
    """
    scene, ports = build_scene(YUMI, TASK, 3), free_ports(YUMI.arm_names)
    qpos = scene.cell.qpos.copy()
    qpos[-18:].reshape(2, 9)[:, :7] += away
    scene = dataclasses.replace(scene, cell=dataclasses.replace(scene.cell, qpos=qpos))
    (folder / "tree.txt").write_text(TREE)
    program = load_program(folder / "tree.txt", "yumi_stack")
    with Log(folder / "twin.jsonl") as log:
        log.write("start", format=1, digest=program.digest, task=TASK.to_dict(), dry=False, settings={"robot": "twin"})
        log.write("end", exit_code=0, seconds=1.0, ticks=10)
    place = cell_camera(TASK)
    lens = Intrinsics(place.matrix, np.zeros(5), place.width, place.height, 0.1)
    save_camera(folder / "camera.yaml", lens, CameraPose(place.pose, 0.001, 8))
    cameras, links = [], []

    def open_camera(source, lens):
        cameras.append(Camera(scene.model, controller.state))
        return cameras[-1]

    def make_link(*arguments, **options):
        links.append(Irc5Link(*arguments, **options))
        return links[-1]

    def busy():
        rare = max((camera.longest for camera in cameras), default=0.0)
        late = max((round.late for link in links for round in link.late_rounds()), default=0.0)
        return f"and {rare:.1f} s without an image" if rare > RARE else "in the link" if late > STARVED else ""

    monkeypatch.setattr(real_cell, "open_camera", open_camera)
    monkeypatch.setattr(real_cell, "Irc5Link", make_link)
    monkeypatch.setattr(preflight, "IMAGE", 5.0)  # the twin renders on the cores on which everything else runs
    with Controller(scene.cell, ports=ports, realtime=True) as controller:
        try:
            RenderedCamera(scene.model, controller.state).close()
        except Exception as problem:
            pytest.skip(f"no renderer: {problem}")
        arguments = {
            "source": folder / "tree.txt",
            "robot": "127.0.0.1",
            "rws_port": controller.rws_port,
            "ports": (ports["left"], ports["right"]),
            "camera": "0",
            "calibration": folder / "camera.yaml",
            "twin_log": folder / "twin.jsonl",
        }
        with skipped_where_starved(controller, busy=busy):
            yield controller, cameras, arguments
