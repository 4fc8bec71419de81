"""`python -m bt_jax.deploy rapid`: the program that runs on the robot's controller, and how it gets there."""

from __future__ import annotations

import importlib.resources
import math
import re
import string

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.deploy.commands.arguments import DEFAULT_TASK, RapidArguments
from bt_jax.deploy.execution.program import refuse_driving
from bt_jax.deploy.link.rws import MODULE
from bt_jax.deploy.link.settings import EGM_SPEED
from bt_jax.deploy.planning.feasibility import check_scale, load_share
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import Task, load_task

__all__ = ["rapid_command", "rapid_module"]

NEXT = """\
It was never run on a controller: read it, and try it in RobotStudio first.
1. Controller: YuMi (IRB 14000), RobotWare 6.07 or a newer 6, option 689-1 (EGM), SmartGripper add-in, tasks T_ROB_L and
   T_ROB_R.
2. Configuration > Communication > Transmission Protocol: BtJax_L and BtJax_R of type UDPUC, with the address of this
   computer as remote address, and remote port 6511 (left) and 6512 (right). Restart the controller.
3. Load {file} into both tasks, as the only module with a main. The loads in it are those of the task and of the model of
   the gripper: measure them with LoadIdentify.
4. Once for each arm, in manual mode: PP to routine calibrate_hand, fingers closed; then jog the arm to where it shall begin,
   and PP to routine teach_ready. Later, go_ready takes it there again: with nothing in its way, as after recover.
5. PP to main in both tasks. Automatic mode, motors on, low speed, the emergency stop in your hand: start the program.
   The arms stand still and tell where they are.
6. Now python -m bt_jax.deploy check --robot ADDRESS sees both arms."""


def rapid_module(task: Task | None = None, *, gripper_mass: float | None = None) -> str:
    """Return the text of the module, with the mass of the heaviest box of a task (default: yumi_stack), and of a gripper
    with its fingers [kg] (default: that of the model). Raise UserError for what an arm cannot take or carry."""
    task = load_task(DEFAULT_TASK) if task is None else task
    check_scale(YUMI, task)
    load_share(YUMI, task, gripper_mass)
    text = importlib.resources.files("bt_jax.deploy.commands").joinpath(f"{MODULE}.mod").read_text(encoding="ascii")
    return string.Template(text).substitute(
        gripper_mass=f"{YUMI.arms[0].gripper.total_mass if gripper_mass is None else gripper_mass:g}",
        part_mass=f"{max(box.mass for box in task.objects):.3f}",
        egm_speed=f"{math.degrees(EGM_SPEED):g}",
    )


def rapid_command(arguments: RapidArguments, console: Console | None = None) -> int:
    """Write the module and print the next steps; the exit code is 0. Raise UserError if it cannot be written."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    path = arguments.out / f"{MODULE}.mod"
    text = rapid_module(refuse_driving(load_task(arguments.task)), gripper_mass=arguments.gripper_mass)
    try:
        write_atomic(path, re.sub("\r?\n", "\r\n", text).encode("ascii"))  # lines end as controllers write them
    except OSError as error:
        raise UserError(f"{path} cannot be written ({error.strerror}); choose another folder with --out") from error
    console.print(f"written    {escape(str(path))}")
    console.print(escape(NEXT.format(file=path.name)))
    return 0
