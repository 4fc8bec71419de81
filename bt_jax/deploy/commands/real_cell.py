"""A real cell: where its parts are, as a user names them, and as many of them opened as can be."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from typing import TypeVar

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import DEFAULT_TASK, RealCellArguments
from bt_jax.deploy.execution.equipment import Equipment, opened
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.irc5_link import Irc5Link
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.link.settings import LinkConfig, link_config
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera_file import load_camera
from bt_jax.deploy.perception.opening import open_camera
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.threaded import BackgroundPerception
from bt_jax.deploy.planning.planner import Planner
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.robot.yumi import YUMI

__all__ = ["OpenedCell", "RealCell", "open_real_cell"]

Part = TypeVar("Part")
HOST = "127.0.0.1"  # of a link that is not opened


@dataclasses.dataclass(frozen=True)
class RealCell:
    """A cell of which nothing is missing."""

    program: Program
    link: Irc5Link
    perception: BackgroundPerception[Perception]
    skills: RobotSkills


@dataclasses.dataclass(frozen=True)
class OpenedCell:
    """What could be opened of a cell; instead of what could not, the reason."""

    equipment: Equipment
    program: Program | UserError
    link: Irc5Link | UserError
    perception: BackgroundPerception[Perception] | UserError | None
    skills: RobotSkills | UserError

    def complete(self) -> RealCell:
        """Return the cell. Raise UserError if a part is missing."""
        return RealCell(
            opened(self.program),
            opened(self.link),
            opened(self.perception, "the robot is blind; give --camera and --calibration"),
            opened(self.skills),
        )


@contextlib.contextmanager
def open_real_cell(arguments: RealCellArguments, *, motion: bool, override: float) -> Iterator[OpenedCell]:
    """Open what can be opened of robot and camera; without `motion` no setpoint ever leaves, and without an address nobody
    is contacted. `override` is the largest joint speed, rad/s."""
    program = _tried(lambda: load_program(arguments.source, arguments.task, otherwise=DEFAULT_TASK))
    calibration: tuple[Intrinsics, CameraPose | None] | UserError | None = None
    if arguments.calibration is not None:
        file = arguments.calibration
        calibration = _tried(lambda: load_camera(file))
    config = link_config(
        YUMI,
        arguments.robot or HOST,
        dict(zip(YUMI.arm_names, arguments.ports, strict=True)),
        arguments.rws_port,
        user=arguments.user,
        password=arguments.password,
        motion=motion,
    )
    rules = _tried(lambda: cell_rules(YUMI, opened(program).task, override=override))
    with contextlib.ExitStack() as stack:

        def see() -> BackgroundPerception[Perception] | None:
            if arguments.camera is None or calibration is None:
                return None
            lens, placed = opened(calibration)
            if placed is None:
                raise UserError("where the camera stands is not known; run python -m bt_jax.deploy calibrate base")
            return stack.enter_context(_perception(opened(program), arguments.camera, lens, placed))

        def act() -> RobotSkills:
            task = opened(program).task
            planning = stack.enter_context(PlanningProcess(YUMI, task)) if motion else None
            return RobotSkills(YUMI, task, opened(link), background=planning)

        perception, link = _tried(see), _tried(lambda: stack.enter_context(_link(arguments, config, rules)))
        skills = _tried(act)
        equipment = Equipment(
            robot=YUMI,
            program=program,
            rules=rules,
            config=config,
            link=link,
            flange=YUMI.flange,
            perception=perception,
            intrinsics_error=calibration if isinstance(calibration, UserError | None) else calibration[0].error,
            camera_residual=_residual(calibration),
            reachable=_reach(program),
            twin_log=arguments.twin_log,
            gripper_mass=arguments.gripper_mass,
        )
        yield OpenedCell(equipment, program, link, perception, skills)


def _link(arguments: RealCellArguments, config: LinkConfig, rules: Rules | UserError) -> Irc5Link:
    """Return the link, not opened. Raise UserError if no controller was named."""
    if arguments.robot is None:
        raise UserError("no controller was named; give its address with --robot")
    return Irc5Link(config, opened(rules))


def _tried(make: Callable[[], Part]) -> Part | UserError:
    """Return what is made, or why it cannot be."""
    try:
        return make()
    except UserError as problem:
        return problem
    except (OSError, RuntimeError, ValueError) as problem:
        return UserError(f"{type(problem).__name__}: {problem}")


def _residual(calibration: tuple[Intrinsics, CameraPose | None] | UserError | None) -> float | UserError | None:
    if isinstance(calibration, UserError | None):
        return calibration
    return None if calibration[1] is None else calibration[1].residual


def _reach(program: Program | UserError) -> Callable[[str, Observation], bool]:
    """Return whether an arm has joints for a grasp of a box at the pose that is seen."""
    planner = None if isinstance(program, UserError) else Planner(YUMI, program.task)

    def reachable(name: str, seen: Observation) -> bool:
        return planner is not None and any(
            planner.can_reach(arm, pose)
            for arm in YUMI.arm_names
            for pose in planner.grasps(arm, name, seen.poses[name])
        )

    return reachable


def _perception(
    program: Program, camera: str, lens: Intrinsics, placed: CameraPose
) -> BackgroundPerception[Perception]:
    def make() -> Perception:
        return Perception(program.task, open_camera(camera, lens), placed.pose)

    return BackgroundPerception(make, close=lambda made: made.camera.close())
