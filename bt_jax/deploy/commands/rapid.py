"""`python -m bt_jax.deploy rapid`: the program that runs on the robot's controller, and how it gets there."""

from __future__ import annotations

import importlib.resources
import re

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.deploy.commands.arguments import RapidArguments
from bt_jax.deploy.link.rws import MODULE

__all__ = ["rapid_command", "rapid_module"]

NEXT = """\
It was never run on a controller: read it, and try it in RobotStudio first.
1. Controller: YuMi (IRB 14000), RobotWare 6.07 or a newer 6, option 689-1 (EGM), SmartGripper add-in, tasks T_ROB_L and
   T_ROB_R.
2. Configuration > Communication > Transmission Protocol: BtJax_L and BtJax_R of type UDPUC, with the address of this
   computer as remote address, and remote port 6511 (left) and 6512 (right). Restart the controller.
3. Load {file} into both tasks, as the only module with a main; set the program pointers to main.
4. Calibrate both grippers. Automatic mode, motors on, low speed, the emergency stop in your hand: start the program.
   The arms stand still and tell where they are.
5. Now python -m bt_jax.deploy check sees both arms."""


def rapid_module() -> str:
    """Return the text of the module."""
    return importlib.resources.files("bt_jax.deploy.commands").joinpath(f"{MODULE}.mod").read_text(encoding="ascii")


def rapid_command(arguments: RapidArguments, console: Console | None = None) -> int:
    """Write the module and print the next steps; the exit code is 0. Raise UserError if it cannot be written."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    path = arguments.out / f"{MODULE}.mod"
    try:
        write_atomic(
            path, re.sub("\r?\n", "\r\n", rapid_module()).encode("ascii")
        )  # lines end as controllers write them
    except OSError as error:
        raise UserError(f"{path} cannot be written ({error.strerror}); choose another folder with --out") from error
    console.print(f"written    {escape(str(path))}")
    console.print(escape(NEXT.format(file=path.name)))
    return 0
