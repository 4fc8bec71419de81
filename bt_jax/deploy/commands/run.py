"""python -m bt_jax.deploy run: a tree on the real cell. Nothing of this was ever tried on a robot.

A run is dry unless `--motion` is given: it sees, ticks, plans and checks, and no setpoint leaves. With `--motion`, the
preflight must pass and a person must type a sentence; the joints then turn at 0.2 rad/s at most.

A protective stop is latched in the process that ran, and nowhere else: there is nothing to reset but the robot itself. The
next run with `--motion` says what stopped the last one, runs the whole preflight, and asks for the sentence again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import shlex
import sys
import time
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import RealCellArguments, RunArguments
from bt_jax.deploy.commands.check import print_preflight
from bt_jax.deploy.commands.display import RunDisplay
from bt_jax.deploy.commands.real_cell import RealCell, open_real_cell
from bt_jax.deploy.execution.executor import Executor
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import log_ends
from bt_jax.deploy.execution.observer import Observer, Perceiving
from bt_jax.deploy.execution.outcome import TickReport
from bt_jax.deploy.execution.preflight import CheckResult, passed
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.robot.yumi import YUMI

__all__ = ["AGAIN", "confirm", "last_stop", "recover_line", "run_command"]

SENTENCE = "the cell is clear"
WARNING = (
    "The robot will move. Software stops replace neither the emergency stop nor a risk assessment: keep the stop in your\n"
    "hand and people out of reach. This program was never tried on a real robot."
)
STOPPED = """\
This was a protective stop: the arms have come to rest and hold. On our side the stop ends with this process, so that nothing
has to be reset here. Remove the cause, clear the error on the pendant, and take the arms home, with or without what they
hold: {recover}
Then, {again}: preflight and sentence come first, as always."""
AGAIN = (
    "in manual mode, take both arms to where they were taught to begin (PP to go_ready in both tasks); "
    "choose PP to main, start BtJax in automatic mode, and run again"
)


def confirm(console: Console) -> None:
    """Ask a person at a terminal. Raise UserError unless exactly the sentence is typed."""
    console.print(f"[bold red]{WARNING}[/]")
    if not sys.stdin.isatty():
        raise UserError("motion must be confirmed at a terminal; run this command in one, or leave out --motion")
    if console.input(f'Type "{SENTENCE}" to go on: ').strip() != SENTENCE:
        raise UserError("motion was not confirmed, nothing has moved; type the sentence as it is written")


def recover_line(arguments: RealCellArguments) -> str:
    """Return the command that takes the arms home in the same cell; a password is not repeated."""
    words = ["python", "-m", "bt_jax.deploy", "recover", str(arguments.source)]
    for field in dataclasses.fields(RealCellArguments):
        value = getattr(arguments, field.name)
        if field.name != "source" and value != field.default:
            values = (
                ["PASSWORD"] if field.name == "password" else map(str, value if isinstance(value, tuple) else [value])
            )
            words += [f"--{field.name.replace('_', '-')}", *values]
    return shlex.join(words)


def last_stop(folder: Path) -> str | None:
    """Return why the newest run with motion that has a log in a folder was stopped; None if it was not, or if there is none.

    Only the first and the last line of a log are read, the newest log first.
    """
    for log in sorted(folder.glob("*.jsonl"), key=lambda path: path.stat().st_mtime, reverse=True):
        with contextlib.suppress(UserError, OSError):
            start, end = log_ends(log)
            if "preflight" not in start.get("settings", {}) or start.get("dry"):
                continue
            if end["kind"] != "end":
                return f"it ended without saying why ({log})"
            return f"{end.get('reason')} ({log})" if end["exit_code"] == Exit.STOPPED else None
    return None


def run_command(arguments: RunArguments, console: Console | None = None) -> int:
    """Run the tree and return the exit code, see `Exit`."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    path = arguments.log or Path("runs") / f"robot-{time.strftime('%Y%m%d-%H%M%S')}.jsonl"
    with open_real_cell(arguments, motion=arguments.motion, override=arguments.speed) as opened:
        items = print_preflight(opened.equipment, console)
        cell = opened.complete()
        cell.link.state()  # raises where the controller does not answer
        if arguments.motion:
            if not passed(items):
                raise UserError("the preflight has not passed; fix what it names, or leave out --motion")
            stop = last_stop(path.parent)
            if stop is not None:
                console.print(
                    f"[bold red]The last run was stopped:[/] {escape(stop)}. Go on only if the cause is gone."
                )
            confirm(console)
        with Log(path) as log:
            console.print(f"log        {escape(str(path))}")
            if arguments.motion:
                cell.link.start()
            with RunDisplay(cell.program, console) as display:
                outcome = _executor(cell, cell.perception, arguments, log, items, display.update).run()
    console.print(f"end        {escape(outcome.reason)}")
    console.print(f"ticks      {outcome.ticks}, {outcome.overruns} too slow; link {cell.link.counters()}")
    if arguments.motion and outcome.exit_code == Exit.STOPPED:
        console.print(escape(STOPPED.format(recover=recover_line(arguments), again=AGAIN)))
    if (unconfirmed := cell.link.unconfirmed()) is not None:
        console.print(f"[bold red]{escape(unconfirmed[0].upper() + unconfirmed[1:])}.[/]")
    return outcome.exit_code


def _executor(
    cell: RealCell,
    perception: Perceiving,
    arguments: RunArguments,
    log: Log,
    items: list[CheckResult],
    tell: Callable[[TickReport], None],
) -> Executor:
    observe = Observer(
        YUMI, cell.program.task, link=cell.link, perception=perception, grasped=lambda: cell.skills.grasped
    )
    settings = {"arguments": _logged(arguments), "preflight": [dataclasses.asdict(item) for item in items]}
    return Executor(
        cell.program,
        skills=cell.skills,
        link=cell.link,
        observe=observe,
        log=log,
        limits=arguments.limits,
        settings=settings,
        dry=not arguments.motion,
        on_tick=tell,
    )


def _logged(arguments: RunArguments) -> dict[str, str]:
    """Return the arguments as text for the log, without the password."""
    return {name: str(value) for name, value in dataclasses.asdict(arguments).items() if name != "password"}
