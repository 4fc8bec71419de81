"""python -m bt_jax.deploy twin --serve: a simulated robot and its camera, for commands in other terminals to be tried on."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import shlex
import time

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import DEFAULT_TASK, TwinArguments
from bt_jax.deploy.execution.program import load_program, refuse_driving
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.link.settings import EGM_SPEED
from bt_jax.deploy.perception.camera_file import save_camera
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.camera_server import CameraServer
from bt_jax.deploy.twin.cell import CAMERA, build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.tasks import Task, load_task

__all__ = ["check_line", "serve_twin"]

GREETING = """\
robot      127.0.0.1, Robot Web Services at port {rws}, EGM to ports {left} and {right}; BtJax runs
camera     {camera}, {width} x {height}, calibration in {calibration}
try        {check}
end        with Ctrl-C"""


def serve_twin(arguments: TwinArguments, console: Console) -> int:
    """Be a robot and a camera until Ctrl-C; print what the controller's event log tells."""
    with contextlib.suppress(OSError):  # a real robot and camera are slowed down by no other program
        os.nice(-10)
    realism = arguments.realism
    realism = dataclasses.replace(realism, egm_speed=min(realism.egm_speed, EGM_SPEED))
    scene = build_scene(YUMI, _task(arguments), arguments.seed, realism)
    ports = dict(zip(YUMI.arm_names, arguments.ports, strict=True))
    save_camera(arguments.calibration, *scene.calibration)
    with (
        Controller(scene.cell, ports=ports, rws_port=arguments.rws_port, realism=realism) as controller,
        CameraServer(arguments.camera_port) as server,
    ):
        controller.press_start()
        camera = RenderedCamera(scene.model, controller.state, CAMERA, realism=realism, seed=[arguments.seed, 3])
        try:
            console.print(
                GREETING.format(
                    rws=controller.rws_port,
                    left=ports["left"],
                    right=ports["right"],
                    camera=server.address,
                    width=realism.width,
                    height=realism.height,
                    calibration=arguments.calibration,
                    check=check_line(arguments, controller.rws_port, server.address),
                ),
                markup=False,
                soft_wrap=True,
            )
            _show(controller, camera, server, console, 1 / min(realism.rate, 30.0))
        except KeyboardInterrupt:
            stats = controller.stats()
            console.print(f"cycles     {stats.cycles}, {stats.missed} missed, {stats.unanswered} unanswered")
        finally:
            camera.close()
    return Exit.DONE


def check_line(arguments: TwinArguments, rws_port: int, camera: str) -> str:
    """Return the command for another terminal that checks a cell with the served robot and `camera`."""
    words = ["python", "-m", "bt_jax.deploy", "check", str(arguments.source or "TREE")]
    if arguments.task is not None:
        words += ["--task", arguments.task]
    words += ["--robot", "127.0.0.1", "--rws-port", str(rws_port), "--ports", *map(str, arguments.ports)]
    return shlex.join([*words, "--camera", camera, "--calibration", str(arguments.calibration)])


def _show(
    controller: Controller, camera: RenderedCamera, server: CameraServer, console: Console, period: float
) -> None:
    """Send images as long as somebody looks, and print new lines of the event log. Raise UserError if the robot fails."""
    told, due = 0, time.monotonic()
    while controller.alive:
        if server.watched:
            server.show(camera.read().image)
        messages = controller.messages()
        for message in messages[told:]:
            console.print(f"event      {escape(str(message))}")
        told = len(messages)
        due = max(due + period, time.monotonic())
        time.sleep(due - time.monotonic() if due > time.monotonic() else 0)
    raise UserError("the twin's controller has ended; start it again")


def _task(arguments: TwinArguments) -> Task:
    if arguments.source is None:
        return refuse_driving(load_task(arguments.task or DEFAULT_TASK))
    return load_program(arguments.source, arguments.task, otherwise=DEFAULT_TASK).task
