"""A real cell, connected: where its parts are, as a user names them, and everything opened in the right order."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Iterator

from bt_jax.deploy.commands.arguments import DEFAULT_TASK, RealCellArguments
from bt_jax.deploy.execution.preflight import Equipment
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.settings import LinkConfig
from bt_jax.deploy.link.yumi_link import YumiLink
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera import open_camera
from bt_jax.deploy.perception.camera_file import load_camera
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.threaded import BackgroundPerception
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.robot.yumi import YUMI

__all__ = ["RealCell", "open_real_cell"]


@dataclasses.dataclass(frozen=True)
class RealCell:
    """The connected parts; `perception` is None without a camera or a calibration."""

    program: Program
    link: YumiLink
    perception: BackgroundPerception[Perception] | None
    skills: RobotSkills
    equipment: Equipment


@contextlib.contextmanager
def open_real_cell(arguments: RealCellArguments, *, motion: bool, override: float) -> Iterator[RealCell]:
    """Connect to robot and camera; without `motion` no setpoint ever leaves. `override` is the largest joint speed, rad/s.

    Raise UserError if the tree cannot be read or the controller or the camera cannot be reached.
    """
    program = load_program(arguments.source, arguments.task, otherwise=DEFAULT_TASK)
    intrinsics: Intrinsics | None = None
    placed: CameraPose | None = None
    if arguments.calibration is not None:
        intrinsics, placed = load_camera(arguments.calibration)
    config = LinkConfig(
        host=arguments.robot,
        ports=dict(zip(YUMI.arm_names, arguments.ports, strict=True)),
        rws_port=arguments.rws_port,
        user=arguments.user,
        password=arguments.password,
        motion=motion,
    )
    with contextlib.ExitStack() as stack:
        perception = None
        if arguments.camera is not None and intrinsics is not None and placed is not None:
            perception = stack.enter_context(_perception(program, arguments.camera, intrinsics, placed))
        link = stack.enter_context(YumiLink(config, cell_rules(YUMI, program.task, override=override)))
        planning = stack.enter_context(PlanningProcess(YUMI, program.task)) if motion else None
        skills = RobotSkills(YUMI, program.task, link, background=planning)
        equipment = Equipment(
            program=program,
            link=link,
            flange=YUMI.flange,
            perception=perception,
            intrinsics_error=None if intrinsics is None else intrinsics.error,
            camera_residual=None if placed is None else placed.residual,
            reachable=skills.reachable,
            twin_log=arguments.twin_log,
        )
        yield RealCell(program, link, perception, skills, equipment)


def _perception(
    program: Program, camera: str, lens: Intrinsics, placed: CameraPose
) -> BackgroundPerception[Perception]:
    def make() -> Perception:
        return Perception(program.task, open_camera(camera, lens), placed.pose)

    return BackgroundPerception(make, close=lambda made: made.camera.close())
