"""python -m bt_jax.deploy check and run: the real cell. Nothing of this was ever tried on a robot.

A run is dry unless `--motion` is given: it sees, ticks, plans and checks, and no setpoint leaves. With `--motion`, the
preflight must pass and a person must type a sentence; the joints then turn at 0.2 rad/s at most.

A protective stop is latched in the process that ran, and nowhere else: there is nothing to reset but the robot itself. The
next run with `--motion` tells what stopped the last one, looks at everything anew, and asks for the sentence again.
"""

from __future__ import annotations

import contextlib
import dataclasses
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax.deploy import yumi
from bt_jax.deploy.execution.executor import Executor, Exit, Limits, Shown
from bt_jax.deploy.execution.log import Log, read_log
from bt_jax.deploy.execution.observer import Observer
from bt_jax.deploy.execution.preflight import Cell, Item, passed, preflight, show
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.skills import YumiSkills
from bt_jax.deploy.link.yumi_link import LinkConfig, YumiLink
from bt_jax.deploy.link.yumi_rules import yumi_rules
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics, load_camera
from bt_jax.deploy.perception.camera import open_camera
from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.perception.threaded import BackgroundPerception
from bt_jax.deploy.planning.process import PlanningProcess

__all__ = ["CheckArguments", "RunArguments", "check_command", "confirm", "last_stop", "run_command"]

FASTEST = 0.2  # rad/s of any joint of a real robot
ATTEMPT = 150.0  # seconds for one attempt at that speed: its motion alone took up to 62 s, planned anew twice as long
SENTENCE = "the cell is clear"
WARNING = (
    "The robot will move. Software stops replace neither the emergency stop nor a risk assessment: keep the stop in your\n"
    "hand and people out of reach. This program was never tried on a real robot."
)
STOPPED = """\
This was a protective stop. The arms hold where they were measured, and the robot's program was stopped; on our side the
stop ends with this process, so that nothing has to be reset here. Remove what caused it, clear the error on the pendant,
choose PP to main and start BtJax on the controller, then run again: preflight and sentence come first, as ever."""


@dataclasses.dataclass(frozen=True)
class CheckArguments:
    """Look at a real cell before anything moves: each item passes, or fails with the remedy."""

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_FOLDER|TREE")]
    """folder that bt_jax.train has written, or a tree as .txt or .xml"""
    task: str | None = None
    """name of a task or YAML file (default: that of the run folder, or yumi_stack)"""
    robot: str = "192.168.125.1"
    """address of the controller"""
    camera: str | None = None
    """number or address of the camera; without motion, also a folder with a recording"""
    calibration: Path | None = None
    """file that calibrate has written"""
    twin_log: Path | None = None
    """log of a run of the same tree in the twin"""
    rws_port: int = 80
    """TCP port of the controller's Robot Web Services"""
    ports: tuple[int, int] = (6511, 6512)
    """UDP ports of this machine to which the left and the right arm's EGM send"""
    user: str = "Default User"
    """of the controller"""
    password: str = "robotics"
    """of that user"""


@dataclasses.dataclass(frozen=True)
class RunArguments(CheckArguments):
    """Execute a tree on a real YuMi. Dry by default: everything but motion.

    A protective stop (exit code 3) cannot be cleared while a run goes on: the arms hold and the run ends. It lives in that
    process only, no command resets it. The robot's own program is stopped too; a person must start it again on the
    controller. The next run with --motion tells what stopped the last one, and needs a passed preflight and the typed
    sentence.
    """

    motion: bool = False
    """move the robot, after preflight and a typed confirmation"""
    speed: float = FASTEST
    """largest joint speed, rad/s"""
    seconds: float = 600.0
    """time after which the run ends"""
    log: Path | None = None
    """where to write the log (default: runs/robot-DATE.jsonl)"""

    def check(self) -> None:
        """Raises UserError for arguments that cannot work."""
        if not 0 < self.speed <= FASTEST:
            raise UserError(f"--speed is {self.speed}; choose rad/s above 0 and up to {FASTEST}")
        if not 0 < self.seconds <= 24 * 3600:
            raise UserError(f"--seconds is {self.seconds}; choose more than 0, and a day at most")
        if self.motion and self.camera is not None and _is_recorded(self.camera):
            raise UserError(
                f"--camera {self.camera} is a recording, not the cell; name a camera, or leave out --motion"
            )

    @property
    def limits(self) -> Limits:
        """Of the run; the slower the joints, the longer an attempt may take."""
        return Limits(run=self.seconds, action=ATTEMPT * FASTEST / self.speed)


def _is_recorded(camera: str) -> bool:
    """Does it name something on a disk that `open_camera` would play?"""
    return Path(camera).is_dir() or (Path(camera).is_file() and not camera.isdigit())


def confirm(console: Console) -> None:
    """Asks a person at a terminal. Raises UserError unless exactly the sentence is typed."""
    console.print(f"[bold red]{WARNING}[/]")
    if not sys.stdin.isatty():
        raise UserError("motion must be confirmed at a terminal; run this command in one, or leave out --motion")
    if console.input(f'Type "{SENTENCE}" to go on: ').strip() != SENTENCE:
        raise UserError("motion was not confirmed, nothing has moved; type the sentence as it is written")


def last_stop(folder: Path) -> str | None:
    """Why the newest run with motion that has a log in a folder was stopped; None where it was not, or there is none."""
    newest: tuple[float, str | None] = (-1.0, None)
    for log in folder.glob("*.jsonl"):
        with contextlib.suppress(UserError, KeyError, OSError):
            entries = list(read_log(log))
            moved = "preflight" in entries[0]["settings"] and not entries[0]["dry"]
            if moved and log.stat().st_mtime > newest[0]:
                newest = (log.stat().st_mtime, _stop_of(entries[-1], log))
    return newest[1]


def _stop_of(end: dict[str, Any], log: Path) -> str | None:
    if end["kind"] != "end":
        return f"it ended without saying why ({log})"
    return f"{end['reason']} ({log})" if end["exit_code"] == Exit.STOPPED else None


@dataclasses.dataclass(frozen=True)
class _Parts:
    program: Program
    link: YumiLink
    perception: BackgroundPerception | None
    skills: YumiSkills
    cell: Cell


@contextlib.contextmanager
def _opened(arguments: CheckArguments, *, motion: bool, override: float) -> Iterator[_Parts]:
    """Everything that a real cell has, connected."""
    program = load_program(arguments.source, arguments.task)
    intrinsics: Intrinsics | None = None
    placed: CameraPose | None = None
    if arguments.calibration is not None:
        intrinsics, placed = load_camera(arguments.calibration)
    config = LinkConfig(
        host=arguments.robot,
        ports=dict(zip(yumi.ARMS, arguments.ports, strict=True)),
        rws_port=arguments.rws_port,
        user=arguments.user,
        password=arguments.password,
        motion=motion,
    )
    with contextlib.ExitStack() as stack:
        perception = None
        if arguments.camera is not None and intrinsics is not None and placed is not None:

            def see() -> Perception:
                return Perception(program.task, open_camera(arguments.camera, intrinsics), placed.pose)

            background = BackgroundPerception(see, close=lambda made: made.camera.close())
            perception = stack.enter_context(background)
        link = stack.enter_context(YumiLink(config, yumi_rules(program.task, override=override)))
        planning = stack.enter_context(PlanningProcess(program.task)) if motion else None
        skills = YumiSkills(program.task, link, background=planning)
        cell = Cell(
            program=program,
            link=link,
            flange=yumi.flange,
            perception=perception,
            intrinsics_error=None if intrinsics is None else intrinsics.error,
            camera_residual=None if placed is None else placed.residual,
            reachable=skills.reachable,
            twin_log=arguments.twin_log,
        )
        yield _Parts(program, link, perception, skills, cell)


def check_command(arguments: CheckArguments, console: Console | None = None) -> int:
    """Prints every item; 0 where all have passed, else 1. Raises UserError where the controller cannot be reached."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    with _opened(arguments, motion=False, override=FASTEST) as parts:
        items = _preflight(parts, console)
    return Exit.DONE if passed(items) else Exit.FAILED


def run_command(arguments: RunArguments, console: Console | None = None) -> int:
    """Runs the tree and gives the exit code of `executor.Exit`."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    path = arguments.log or Path("runs") / f"robot-{time.strftime('%Y%m%d-%H%M%S')}.jsonl"
    with _opened(arguments, motion=arguments.motion, override=arguments.speed) as parts:
        items = _preflight(parts, console)
        if parts.perception is None:
            raise UserError("the robot is blind; give --camera and --calibration")
        if arguments.motion:
            if not passed(items):
                raise UserError("the preflight has not passed; mend what it names, or leave out --motion")
            stop = last_stop(path.parent)
            if stop is not None:
                console.print(
                    f"[bold red]The last run was stopped:[/] {escape(stop)}. Go on only if the cause is gone."
                )
            confirm(console)
        with Log(path) as log:
            console.print(f"log        {escape(str(path))}")
            if arguments.motion:
                parts.link.start()
            outcome = _executor(parts, arguments, log, items, console).run()
    console.print(f"end        {escape(outcome.reason)}")
    console.print(f"ticks      {outcome.ticks}, {outcome.overruns} too slow; link {parts.link.counters()}")
    if arguments.motion and outcome.exit_code == Exit.STOPPED:
        console.print(escape(STOPPED))
    return outcome.exit_code


def _preflight(parts: _Parts, console: Console) -> list[Item]:
    items = []
    for item in preflight(parts.cell):
        show(console, item)
        items.append(item)
    return items


def _executor(parts: _Parts, arguments: RunArguments, log: Log, items: list[Item], console: Console) -> Executor:
    phase = ""

    def tell(shown: Shown) -> None:
        nonlocal phase
        if shown.phase != phase:
            phase = shown.phase
            console.print(f"{shown.seen.time:10.2f} s  {phase}  {shown.action or ''}", markup=False)

    observe = Observer(
        parts.program.task,
        link=parts.link,
        perception=parts.perception,
        grasped=lambda: parts.skills.grasped,
        tcp=yumi.forward,
    )
    settings = {"arguments": _told(arguments), "preflight": [dataclasses.asdict(item) for item in items]}
    return Executor(
        parts.program,
        skills=parts.skills,
        link=parts.link,
        observe=observe,
        log=log,
        limits=arguments.limits,
        settings=settings,
        dry=not arguments.motion,
        on_tick=tell,
    )


def _told(arguments: RunArguments) -> dict[str, str]:
    """For the log, without the password."""
    return {name: str(value) for name, value in dataclasses.asdict(arguments).items() if name != "password"}
