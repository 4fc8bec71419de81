"""What the commands of `bt_jax.deploy` take: what `--help` shows, without MuJoCo, OpenCV and Pinocchio, which are slow to
import."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated, Literal

import tyro

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.settings import TWIN_SECONDS, Limits
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks.bounds import Bound

__all__ = [
    "DEFAULT_TASK",
    "FILMS",
    "REDUCED_SPEED",
    "CalibrateArguments",
    "CheckArguments",
    "MarkersArguments",
    "MovingArguments",
    "RapidArguments",
    "RatesArguments",
    "RealCellArguments",
    "RecoverArguments",
    "ReplayArguments",
    "RunArguments",
    "TwinArguments",
]

DEFAULT_TASK = "yumi_stack"
REDUCED_SPEED = 0.2  # rad/s, the largest of any joint that a command asks of a real robot
ATTEMPT = 150.0  # seconds for one attempt at REDUCED_SPEED: its motion took up to 62 s, with one new plan twice as long
FILMS = (".mp4", ".gif", ".png")
PORT, FREE_PORT = Bound(1.0, 65535.0), Bound(0.0, 65535.0)  # 0: any port that is free
GRIPPER_MASS = Bound(0.01, 5.0, "kg", ("g", 0.001))
SQUARE = Bound(0.001, 1.0, "m", ("mm", 0.001))
VIEWS, PIXELS = Bound(3.0, 1000.0), Bound(64.0, 16384.0)


def _check(option: str, value: float | int, bound: Bound) -> None:
    """Raise UserError if the value of an option is out of bounds, or no number."""
    if (complaint := bound.complaint(float(value))) is not None:
        raise UserError(f"{option} {complaint}")


def _check_mass(mass: float | None) -> None:
    if mass is not None:
        _check("--gripper-mass", mass, GRIPPER_MASS)


def _check_ports(ports: tuple[int, int]) -> None:
    for port in ports:
        _check("--ports", port, PORT)
    if len(set(ports)) < len(ports):
        raise UserError(f"--ports names {ports[0]} twice; choose another port for each arm")


@dataclasses.dataclass(frozen=True)
class RealCellArguments:
    """What to run, and how the robot and the camera are reached."""

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_FOLDER|TREE")]
    """folder that bt_jax.train or bt_jax.learn has written, or a tree as .txt or .xml"""
    task: str | None = None
    """name of a task or YAML file (default: that of the run folder, or yumi_stack)"""
    robot: str | None = None
    """address of the controller: 192.168.125.1 at its service port. No address is contacted that is not given"""
    camera: str | None = None
    """number or address of the camera, or a folder with a recording"""
    calibration: Path | None = None
    """file that calibrate has written"""
    twin_log: Path | None = None
    """log of a run of the same tree in the twin"""
    gripper_mass: float | None = None
    """kg of a gripper with its fingers (default: that of the model), for the payload"""
    rws_port: int = 80
    """TCP port of the controller's Robot Web Services"""
    ports: tuple[int, int] = (6511, 6512)
    """UDP ports of this machine to which the left and the right arm's EGM send"""
    user: str = "Default User"
    """user name on the controller"""
    password: str = "robotics"
    """password of that user"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        _check_mass(self.gripper_mass)
        _check("--rws-port", self.rws_port, PORT)
        _check_ports(self.ports)


@dataclasses.dataclass(frozen=True)
class MovingArguments(RealCellArguments):
    """Of a command that moves a real robot, where `moves` says so."""

    speed: float = REDUCED_SPEED
    """largest joint speed, rad/s"""

    @property
    def moves(self) -> bool:
        """Will the arms move?"""
        return True

    def check(self) -> None:
        """Raise UserError for arguments that cannot work, or with which the arms would move by old pictures."""
        super().check()
        if not 0 < self.speed <= REDUCED_SPEED:
            raise UserError(f"--speed is {self.speed}; choose rad/s above 0 and up to {REDUCED_SPEED}")
        if self.moves and self.camera is not None and _is_recorded(self.camera):
            raise UserError(f"--camera {self.camera} is a recording, not the cell; name a camera, or {self._without}")

    @property
    def _without(self) -> str:
        """What to do without a camera."""
        return "leave out --camera"


@dataclasses.dataclass(frozen=True)
class CheckArguments(RealCellArguments):
    """Look at a real cell before anything moves: each item passes, or fails with the remedy.

    Whatever is missing or broken makes its own items fail and hides no others; without --robot, all is checked that needs no
    controller.
    """


def _is_recorded(camera: str) -> bool:
    """Does it name something on a disk that `open_camera` would play?"""
    return Path(camera).is_dir() or (Path(camera).is_file() and not camera.isdigit())


@dataclasses.dataclass(frozen=True)
class RunArguments(MovingArguments):
    """Execute a tree on a real YuMi. Dry by default: everything but motion.

    A protective stop (exit code 3) cannot be cleared while a run goes on: the arms hold and the run ends. It lives in that
    process only, no command resets it. The robot's own program is stopped too; a person must start it again on the
    controller. The next run with --motion says what stopped the last one, and needs a passed preflight and the typed
    sentence.
    """

    camera: str | None = None
    """number or address of the camera; without --motion, also a folder with a recording"""
    motion: bool = False
    """move the robot, after preflight and a typed confirmation"""
    seconds: float = 600.0
    """time after which the run ends"""
    log: Path | None = None
    """where to write the log (default: runs/robot-DATE.jsonl)"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        super().check()
        if not 0 < self.seconds <= 24 * 3600:
            raise UserError(f"--seconds is {self.seconds}; choose more than 0, and a day at most")

    @property
    def moves(self) -> bool:
        """Only with --motion."""
        return self.motion

    @property
    def _without(self) -> str:
        return "leave out --motion"

    @property
    def limits(self) -> Limits:
        """Limits of the run; the slower the joints, the longer an attempt may take."""
        return Limits(run=self.seconds, action=ATTEMPT * REDUCED_SPEED / self.speed)


@dataclasses.dataclass(frozen=True)
class RecoverArguments(MovingArguments):
    """Take the arms home after a stop, whatever they hold.

    Shows the state, and asks for a word: "release" opens the grippers first, "keep" takes along what they hold. Then each
    arm rises straight up and goes home, slowly. Give what was given to `run`: with a camera, what it sees is kept clear of.
    """

    camera: str | None = None
    """number or address of the camera; a recording does not do, since the arms move"""
    speed: float = REDUCED_SPEED / 2
    """largest joint speed, rad/s"""


@dataclasses.dataclass(frozen=True)
class TwinArguments:
    """Execute a tree on the twin of a YuMi: rendered camera, markers, planning, EGM at 250 Hz, grasps by friction.

    With --serve no tree is executed: robot and camera wait for `check` and `run` from another terminal, as real ones would.
    """

    source: Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_FOLDER|TREE")] = None
    """folder that bt_jax.train or bt_jax.learn has written, or a tree as .txt or .xml"""
    task: str | None = None
    """name of a task or YAML file (default: that of the run folder, or yumi_stack)"""
    disturb: bool = False
    """let a person move boxes, take them away and bring them back"""
    touches: int = 1
    """how often the person does so in a run, with --disturb"""
    faults: str | None = None
    """what goes wrong, as in the simulation, in place of what the task says: mild, harsh, or a YAML file"""
    draw: int = 1
    """number, from 1, of the draw of chance in the layout, with faults"""
    seed: int = 0
    """number of the layout"""
    layouts: int = 1
    """with more than one, run in the layouts seed, seed + 1, ... and report how often the tree succeeds"""
    realtime: bool = False
    """keep the robot's own pace, 250 Hz by the clock; else simulated time, as fast as it goes"""
    seconds: float = TWIN_SECONDS
    """time after which a run ends"""
    render: Path | None = None
    """film the run: .mp4, .gif, or .png for six stills"""
    log: Path | None = None
    """where to write the log (default: runs/twin-DATE.jsonl; with --layouts, a folder)"""
    serve: bool = False
    """be a robot and a camera for other commands, in real time, until Ctrl-C"""
    ports: tuple[int, int] = (6511, 6512)
    """with --serve, UDP ports of this machine to which the left and the right arm's EGM send"""
    rws_port: int = 8080
    """with --serve, TCP port of Robot Web Services"""
    camera_port: int = 8090
    """with --serve, TCP port of the camera"""
    calibration: Path = Path("twin_camera.yaml")
    """with --serve, where to write the camera's calibration"""
    perfect: bool = False
    """a perfect cell: sharp images of 640 x 480, arms and grippers that follow at once, no limits"""
    worse: float = 1.0
    """how many times as bad as by default the cell is"""
    realism: Realism = dataclasses.field(default_factory=Realism)
    """how far the cell is from a perfect one; single values count before --perfect and --worse"""

    def with_preset(self) -> TwinArguments:
        """Return the arguments that are the defaults once --perfect or --worse was given. Raise UserError if both were."""
        if self.perfect and self.worse != 1:
            raise UserError("--perfect and --worse exclude each other; leave one out")
        if not 0 < self.worse <= 10:
            raise UserError(f"--worse is {self.worse}; choose a factor above 0 and up to 10")
        preset = Realism.perfect() if self.perfect else Realism().scaled(self.worse)
        return dataclasses.replace(self, realism=preset)

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.layouts < 1 or self.touches < 1 or self.seed < 0 or self.draw < 1:
            raise UserError("--layouts, --touches and --draw start at 1 and --seed at 0; choose others")
        if self.faults is not None and self.disturb:
            raise UserError("--faults says what a person does, too; leave out --disturb")
        if not 0 < self.seconds <= 3600:
            raise UserError(f"--seconds is {self.seconds}; choose more than 0, and an hour at most")
        self.realism.check()
        _check_ports(self.ports)
        _check("--rws-port", self.rws_port, FREE_PORT)
        _check("--camera-port", self.camera_port, FREE_PORT)
        if self.serve:
            given = (
                self.disturb,
                self.faults is not None,
                self.layouts > 1,
                self.render is not None,
                self.log is not None,
            )
            if any(given):
                raise UserError(
                    "--serve executes no tree; leave out --disturb, --faults, --layouts, --render and --log"
                )
        elif self.source is None:
            raise UserError("a tree is missing; name a run folder or a file with a tree, or give --serve")
        if self.render is not None:
            if self.layouts > 1:
                raise UserError("a film shows one layout; leave out --layouts, or choose one with --seed")
            if self.render.suffix.lower() not in FILMS:
                raise UserError(f"{self.render} is not a film; let its name end in {', '.join(FILMS)}")
            if not self.render.parent.is_dir():
                raise UserError(f"there is no folder {self.render.parent}; make it, or name another")


@dataclasses.dataclass(frozen=True)
class MarkersArguments:
    """Markers for the boxes and the kit of a task, and the board for `calibrate intrinsics`."""

    task: str = DEFAULT_TASK
    """name or .yaml file of the task"""
    out: Path = Path("markers")
    """folder for markers.pdf and one PNG a page"""
    paper: str = "a4"
    """a4 or letter"""


@dataclasses.dataclass(frozen=True)
class CalibrateArguments:
    """First `intrinsics`, with the printed board; then `base`, with markers at known places."""

    step: tyro.conf.Positional[Literal["intrinsics", "base"]]
    """what to calibrate"""
    camera: str = "0"
    """number or address of a camera, or a folder with pictures that it took"""
    file: Path = Path("camera.yaml")
    """where the calibration is kept"""
    points: Path | None = None
    """for base: a YAML file with a line `ID: [x, y, z]` for each marker, its centre in the robot's base frame in metres"""
    square: float = 0.035
    """for intrinsics: edge of the board's squares, measured on the print, in metres"""
    views: int = 20
    """for intrinsics with a live camera: from how many sides to look at the board"""
    width: int = 1280
    """of the camera's images, px; the larger, the better markers are read and placed"""
    height: int = 960
    """of the camera's images, px"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        _check("--square", self.square, SQUARE)
        _check("--views", self.views, VIEWS)
        _check("--width", self.width, PIXELS)
        _check("--height", self.height, PIXELS)


@dataclasses.dataclass(frozen=True)
class RapidArguments:
    """Write the RAPID module that the robot's controller must run, and say what to do with it.

    It was never run on a controller. It has to be loaded into both arms' tasks, T_ROB_L and T_ROB_R, of a YuMi with
    RobotWare 6.07 or a newer 6, option 689-1 Externally Guided Motion and the SmartGripper add-in. Each arm needs a UDPUC
    transmission protocol, BtJax_L (remote port 6511) and BtJax_R (6512), with the address of this computer. A person teaches
    where the arms begin and starts the program; the arms then stand still, tell where they are, and follow setpoints only
    once `run --motion` asks for it.
    """

    task: str = DEFAULT_TASK
    """name or .yaml file of the task whose heaviest box the controller is told"""
    gripper_mass: float | None = None
    """kg of a gripper with its fingers (default: that of the model)"""
    out: Path = Path("rapid")
    """folder for the module"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        _check_mass(self.gripper_mass)


@dataclasses.dataclass(frozen=True)
class RatesArguments:
    """Estimate from logs how often what goes wrong: slips, drops, jams, errors of places, and what a person does.

    Each rate comes with its 95 % interval, which is wide where there were few tries. The file says the rates as `--faults`
    of train, run and twin reads them.
    """

    logs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="LOG|FOLDER")]
    """files that twin or run has written, or folders of them"""
    out: Path | None = None
    """YAML file to write the rates to"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.out is not None and self.out.suffix not in (".yaml", ".yml"):
            raise UserError(f"{self.out} is no file of faults; let its name end in .yaml")
        if self.out is not None and not self.out.parent.is_dir():
            raise UserError(f"there is no folder {self.out.parent}; make it, or name another")


@dataclasses.dataclass(frozen=True)
class ReplayArguments:
    """Show what a log tells: every change of the tree, attempts, and why the run ended."""

    log: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="LOG")]
    """file that twin or run has written"""
    every: bool = False
    """show every tick, not only those in which a status changed"""
