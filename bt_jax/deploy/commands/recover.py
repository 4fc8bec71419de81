"""python -m bt_jax.deploy recover: take the arms home after a stop, and let go of what they hold. Never tried on a robot."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Container
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import RecoverArguments
from bt_jax.deploy.commands.check import print_preflight
from bt_jax.deploy.commands.real_cell import OpenedCell, open_real_cell
from bt_jax.deploy.commands.run import AGAIN, last_stop
from bt_jax.deploy.execution.equipment import opened
from bt_jax.deploy.execution.homing import take_home
from bt_jax.deploy.execution.preflight import ARMS_HELD, CAMERA, FINDINGS, passed
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.link.irc5_link import Irc5Link

__all__ = ["recover_command"]

RELEASE, KEEP = "release", "keep"
WARNING = """\
The robot will move: both arms, each straight up and then home, at {speed:g} rad/s at most. {seen}
Software stops replace neither the emergency stop nor a risk assessment: keep the stop in your hand and people out of reach.
This program was never tried on a real robot."""
QUESTION = 'Type "release" to open the grippers first (hold what they carry), or "keep" to take along what they hold: '


def recover_command(arguments: RecoverArguments, console: Console | None = None) -> int:
    """Show the state, ask for a word, and take the arms home; return the exit code."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    with open_real_cell(arguments, motion=True, override=arguments.speed) as cell:
        link, skills = opened(cell.link), opened(cell.skills)
        _show(link, console)
        if arguments.camera is not None:
            _require(cell, console, CAMERA)
        watched = (
            "What the camera sees is kept clear of."
            if cell.perception is not None
            else "Boxes are not seen, and not kept clear of."
        )
        console.print(f"[bold red]{escape(WARNING.format(speed=arguments.speed, seen=watched))}[/]")
        keep = _asked(console) == KEEP
        link.start(here=True)
        try:
            _require(cell, console, ARMS_HELD if cell.perception is not None else set(ARMS_HELD) - {FINDINGS})
            perception = None if cell.perception is None else opened(cell.perception)
            problem = take_home(link, skills, perception, keep=keep)
        except KeyboardInterrupt:
            link.interrupt()
            more = link.stop("interrupted")
            console.print(f"end        interrupted{escape(f'; {more}' if more else '')}")
            return Exit.INTERRUPTED
    console.print(f"end        {escape(problem or f'the arms are home; {AGAIN}')}")
    if (unconfirmed := link.unconfirmed()) is not None:
        console.print(f"[bold red]{escape(unconfirmed)}[/]")
    return Exit.FAILED if problem else Exit.DONE


def _show(link: Irc5Link, console: Console) -> None:
    """Print what is known before anything moves. Raise UserError if the controller does not answer, or is not ready."""
    state = link.state()
    console.print(f"controller {state.control}, mode {state.mode}, RAPID {state.rapid}")
    with contextlib.suppress(UserError):  # a log that cannot be read keeps no arm from home
        for message in link.messages()[:3]:
            console.print(f"log        {escape(str(message))}")
    for arm, opening in link.openings().items():
        console.print(f"{arm:10s} fingers {1000 * opening:.1f} mm apart")
    stop = last_stop(Path("runs"))
    if stop is not None:
        console.print(f"last run   {escape(stop)}")
    if not state.ready:
        raise UserError("the controller is not ready; clear the error on the pendant, automatic mode, motors on")


def _require(cell: OpenedCell, console: Console, items: Container[str]) -> None:
    """Print items of the preflight. Raise UserError if one has not passed."""
    if not passed(print_preflight(cell.equipment, console, items)):
        raise UserError("nothing has moved; fix what the items name, or leave out --camera where it is the camera")


def _asked(console: Console) -> str:
    """Ask a person at a terminal what is to become of what the grippers hold. Raise UserError for any other word."""
    if not sys.stdin.isatty():
        raise UserError("a recovery must be confirmed at a terminal; run this command in one")
    word = console.input(QUESTION).strip()
    if word not in (RELEASE, KEEP):
        raise UserError(f'nothing has moved; type "{RELEASE}" or "{KEEP}"')
    return word
