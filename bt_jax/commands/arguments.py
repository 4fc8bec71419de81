"""What the commands take: what `--help` shows, without JAX and MuJoCo, which take longer to import than help may."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from bt_jax._util.errors import UserError
from bt_jax._util.startup import Device
from bt_jax.gp.config import GPConfig
from bt_jax.lfd.clustering import NEEDED
from bt_jax.tasks import load_task
from bt_jax.tasks.bounds import NOISE
from bt_jax.training.published import published_config
from bt_jax.training.settings import Backend, Level, Settings

__all__ = [
    "CheckArguments",
    "DemonstrateArguments",
    "LearnArguments",
    "ReportArguments",
    "RunArguments",
    "TrainArguments",
    "check_out",
    "parse_train",
    "unset",
]

NOT_ROBOT = (
    "backend",
    "test",
    "expand",
    "verbose",
    "simplify",
    "export",
    "delay",
    "device",
)  # options of the other levels
NOT_WATCHED = ("script", "noise", "after", "rename", "delete")  # options of `demonstrate` that --watch does not take
WATCHED = ("camera", "calibration", "fps", "idle", "unclear", "record")  # and those that nothing else takes
TRAIN = "python -m bt_jax.train"


REGISTRY = tyro.constructors.ConstructorRegistry()


@REGISTRY.primitive_rule
def _number_or_auto(info: tyro.constructors.PrimitiveTypeInfo) -> tyro.constructors.PrimitiveConstructorSpec | None:
    """Call a number auto that is None, as what the evolution chooses by itself."""
    if info.type != (int | None):
        return None
    return tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT|auto",
        instance_from_str=lambda words: None if words[0] == "auto" else int(words[0]),
        is_instance=lambda value: value is None or isinstance(value, int),
        str_from_instance=lambda value: ["auto" if value is None else str(value)],
    )


def unset(metavar: str) -> Any:
    """Return how `--help` shows an option that has no value unless one is given: its text says what happens then."""
    return tyro.conf.arg(
        metavar=metavar, help_behavior_hint=lambda value: "" if value == "None" else f"(default: {value})"
    )


def check_out(folder: Path | None) -> None:
    """Raise UserError unless a folder for results is new or empty."""
    if folder is not None and folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UserError(f"{folder} is {'not empty' if folder.is_dir() else 'a file'}; choose another --out")


@dataclasses.dataclass(frozen=True)
class TrainArguments:
    """Evolve a Behavior Tree for a pick-and-place task.

    It ends once the task is solved and nothing improves. Ctrl-C stops early and keeps the best tree and a checkpoint.
    """

    name: Annotated[str | None, tyro.conf.Positional, unset("[TASK]")] = None
    """task that comes with the package: stack (default), stack3, pyramid, restack, kit4, kit6, kit9, kit12, towers, bolts,
    fixture; mobile_stack or mobile_kit, where the robot drives; or one at the scale of a YuMi: yumi_stack, yumi_kit4,
    yumi_bolts, ..."""
    task: Annotated[Path | None, unset("PATH")] = None
    """a task of your own, a YAML file"""
    published: bool = False
    """evolve with the method, settings and rules of the published runs; options that are given still count"""
    gp: Annotated[tyro.conf.OmitArgPrefixes[GPConfig], tyro.conf.arg(name="evolution")] = dataclasses.field(
        default_factory=GPConfig
    )
    settings: Annotated[tyro.conf.OmitArgPrefixes[Settings], tyro.conf.arg(name="simulation")] = dataclasses.field(
        default_factory=Settings
    )
    faults: Annotated[str | None, unset("mild|harsh|PATH")] = None
    """what goes wrong, in place of what the task says: mild, harsh, or a YAML file"""
    baseline: Annotated[Path | None, unset("PATH")] = None
    """tree (.txt or .xml) to start from, or a folder of train or learn with one; its parts stay available"""
    plan: bool = False
    """start from the tree that a planner makes for the task's targets and subgoals; what is in the way is put aside"""
    without: tuple[str, ...] = ()
    """leaves that evolution does not use, for instance "move(BlueBox, (0, 0, 0.05), GreenBox)"; a part of the baseline that
    is to stay whole is written as subtask(NAME, ...)"""
    add_target_from: Annotated[Path | None, unset("PATH")] = None
    """folder of demonstrations: their places become targets and genes, their tree the baseline if no other is given"""
    add_subgoal_from: Annotated[Path | None, unset("PATH")] = None
    """folder of demonstrations of a step on the way: one gene, and a reward for what it reaches"""
    resume: Annotated[Path | None, unset("PATH")] = None
    """run folder to resume, as if it had never stopped; only --generations, --patience, --target-fitness and --time-limit
    may differ. With --baseline, --plan, --add-target-from or --add-subgoal-from a new phase begins there; so it does with
    --task, for the targets and starts of that file"""
    target_fitness: Annotated[float | None, unset("FLOAT")] = None
    """stop once the best fitness of every run has reached this"""
    time_limit: Annotated[float | None, unset("FLOAT")] = None
    """stop after so many seconds of evolution"""
    out: Annotated[Path | None, unset("PATH")] = None
    """folder for the results (default: runs/TASK-DATE-TIME)"""
    device: Device = "auto"
    """where JAX computes"""
    progress: bool = False
    """keep RUN/progress.json up to date while it runs, for other programs that show it"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.resume is not None and self.out is not None:
            raise UserError("--resume goes on in its own folder; leave out --out")
        if self.resume is not None and self.faults is not None:
            raise UserError("--resume keeps the faults of its run; leave out --faults")
        if self.resume is None and self.name is not None and self.task is not None:
            raise UserError("two tasks are given; name one, or give one file with --task")
        if self.resume is not None and self.without:
            raise UserError("--resume keeps the leaves of its run; leave out --without")
        if self.target_fitness is not None and math.isnan(self.target_fitness):
            raise UserError("--target-fitness is nan; choose a number, for instance -40")
        if self.time_limit is not None and not self.time_limit > 0:
            raise UserError(f"--time-limit is {self.time_limit:g}; choose seconds above 0")


def parse_train(words: Sequence[str]) -> TrainArguments:
    """Return the arguments of a command line; the settings of a resumed or published run are the defaults."""
    parse = functools.partial(tyro.cli, TrainArguments, prog=TRAIN, args=words, registry=REGISTRY)
    arguments = parse()
    if arguments.published and arguments.resume is not None:
        raise UserError("--resume keeps the settings of its run; leave out --published")
    if arguments.published:
        name = load_task(arguments.task or arguments.name or "stack").name
        return parse(default=TrainArguments(gp=published_config(name)))
    if arguments.resume is None:
        return arguments
    from bt_jax.training.run_folder import RunFolder  # imports JAX, which --help does without

    saved = RunFolder(arguments.resume).config()
    gp = dataclasses.replace(saved.gp, baseline_index=None)  # that of the run's baseline, not of a new one
    return parse(default=TrainArguments(gp=gp, settings=saved.settings))


@dataclasses.dataclass(frozen=True)
class LearnArguments:
    """Learn a Behavior Tree from recorded demonstrations, say what was inferred and why, and try it in simulation."""

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """folder with info.yaml and demoN/data_K.yaml"""
    task: Annotated[str | None, unset("NAME")] = None
    """name of a task or YAML file: the scene in which the tree is tried (default: that of the demonstrations, or stack3)"""
    frames: tuple[str, ...] = ()
    """frames of your choice, as ACTION=FRAME with the number of the action, for instance 2=GreenBox; 2=auto takes that back.
    They are kept with the demonstrations"""
    answers: tuple[str, ...] = ()
    """answers to questions, as QUESTION=ANSWER with the numbers that are printed, for instance 1=2. They are kept, too"""
    take_back: tuple[int, ...] = ()
    """numbers of answers that no longer count"""
    propose: bool = False
    """arrange the start of the demonstration that would answer the questions, and write it as a task file"""
    out: Annotated[Path | None, unset("PATH")] = None
    """folder for the results (default: runs/learn-FOLDER-DATE-TIME)"""
    layouts: int = 20
    """layouts in which the tree is tried"""
    level: Level = "physics"
    """physics or kinematic"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.layouts < 1:
            raise UserError(f"--layouts is {self.layouts}; choose 1 or more")
        check_out(self.out)


@dataclasses.dataclass(frozen=True)
class RunArguments:
    """Execute a saved Behavior Tree in simulation and show, tick by tick, which nodes are active."""

    source: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_FOLDER|TREE")]
    """folder that bt_jax.train or bt_jax.learn has written, or a tree as .txt or .xml"""
    task: Annotated[str | None, unset("NAME")] = None
    """name of a task or YAML file (default: that of the folder, or stack; yumi_stack for the robot)"""
    level: Annotated[Level | Literal["robot"] | None, unset("{physics,kinematic,robot}")] = None
    """physics, kinematic, or robot, the twin of a YuMi (default: that of the run folder, or physics)"""
    backend: Backend = "auto"
    """engine of the physics level; auto takes mujoco, which needs no compiling"""
    seed: int = 0
    """number of the layout; training meets none of these"""
    layouts: int = 1
    """with more than one, run in the layouts seed, seed + 1, ... and report how often the tree succeeds"""
    layout: Annotated[int | None, unset("INT")] = None
    """instead of a seed: the number, from 1, of one of the unseen layouts that the run folder's tree was tested in"""
    faults: Annotated[str | None, unset("mild|harsh|PATH")] = None
    """what goes wrong, in place of what the task says: mild, harsh, or a YAML file"""
    draw: Annotated[int | None, unset("INT")] = None
    """number, from 1, of the draw of chance in the layout (default: 1)"""
    test: bool = False
    """test the run folder's tree again: in the unseen layouts and draws of its test, with --faults under others"""
    render: Annotated[Path | None, unset("PATH")] = None
    """film the episode: .mp4, .gif, or .png for six stills"""
    expand: bool = False
    """show what is inside genes"""
    verbose: bool = False
    """print the whole tree at every tick, not only what has changed (a terminal shows it in one place)"""
    simplify: bool = False
    """first remove every node that does nothing in 100 unseen layouts; if it removes any, it writes
    simplified_tree.* into the folder"""
    export: Annotated[Path | None, unset("PATH")] = None
    """write the tree as .xml (BehaviorTree.CPP, Groot2), .svg, .dot or .txt, and run it only if --layouts, --render or
    --verbose ask for it"""
    delay: float = 0.5
    """seconds between two ticks on a terminal"""
    device: Device = "auto"
    """where JAX computes"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.layouts < 1:
            raise UserError(f"--layouts is {self.layouts}; choose 1 or more")
        if self.seed < 0:
            raise UserError(f"--seed is {self.seed}; choose 0 or more")
        if not 0 <= self.delay <= 60:
            raise UserError(f"--delay is {self.delay}; choose seconds from 0 to 60")
        if self.layout is not None and (self.layouts > 1 or self.seed):
            raise UserError("--layout plays one layout of a run's test; leave out --layouts and --seed")
        if self.draw is not None and self.draw < 1:
            raise UserError(f"--draw is {self.draw}; choose 1 or more")
        if self.test and (self.layouts > 1 or self.seed or self.layout or self.draw or self.render):
            raise UserError(
                "--test takes all layouts and draws of a run's test; leave out the options that choose some"
            )
        if self.render is not None and self.layouts > 1:
            raise UserError("a film shows one layout; leave out --layouts, or choose one with --seed")
        defaults = RunArguments(self.source)
        wrong = [name for name in NOT_ROBOT if getattr(self, name) != getattr(defaults, name)]
        if self.level == "robot" and wrong:
            raise UserError(f"--level robot does not take --{' and --'.join(wrong)}; leave out what it does not take")


@dataclasses.dataclass(frozen=True)
class CheckArguments:
    """Read files and folders without running anything, and say what they are and what is wrong with them.

    Every one is read, whatever is wrong with others. The exit code is 0 if all are fine, and 2 if not.
    """

    files: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE")]
    """tasks, trees (.txt, .xml), folders of demonstrations, of train or of learn, kits (.kit.zip), calibration files, logs
    of the robot; of another folder, everything in it"""

    def check(self) -> None:
        """Raise UserError if there is nothing to check."""
        if not self.files:
            raise UserError("there is nothing to check; give one file or more")


@dataclasses.dataclass(frozen=True)
class ReportArguments:
    """Write a report about a run: what its tree does, in words and as a picture, how often it works, and why it fails.

    It is one HTML file, for a browser or a printer; the page shows the same.
    """

    run: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="RUN_FOLDER")]
    """folder that bt_jax.train has written"""
    out: Annotated[Path | None, unset("PATH")] = None
    """file to write (default: report.html in the folder)"""


@dataclasses.dataclass(frozen=True)
class DemonstrateArguments:
    """Record demonstrations in the published format: in simulation from a script, or of a person whom a camera watches.

    A script is what the person at the gripper does, separated by semicolons or lines:
    pick OBJECT; move (DX, DY, DZ); turn DEGREES; to (X, Y, Z) FRAME [DEGREES]; to SLOT; release. Metres; the object's centre
    counts. Of a part, the nearest instance is picked that was not moved before; a slot is written as in TrayA.a1.

    With --watch a person moves boxes that carry markers, by hand, one after the other. A move counts once the box is at rest
    and the hands have left it.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """folder of demonstrations; new ones are added"""
    script: Annotated[str | None, tyro.conf.Positional, unset("[SCRIPT]")] = None
    """the script, for instance "pick BlueBox; to (0, 0, 0.12) GreenBox; release", or a file with one; without it, the
    demonstrations in the folder are listed"""
    task: Annotated[str | None, unset("NAME")] = None
    """name of a task or YAML file (default: that of --after, of the folder, or stack3; with --watch, that of the folder or
    yumi_stack)"""
    count: int = NEEDED
    """how many demonstrations, each in another layout"""
    seed: Annotated[int | None, unset("INT")] = None
    """number of the first layout (default: the first that no demonstration in the folder has used)"""
    noise: float = 0.0
    """standard deviation with which the person misses each place, along each axis, metres"""
    after: Annotated[Path | None, unset("PATH")] = None
    """run folder or tree that is executed first: the demonstration begins where it ends"""
    rename: Annotated[tuple[str, str] | None, unset("OLD NEW")] = None
    """gives a demonstration another name: OLD NEW"""
    delete: Annotated[str | None, unset("NAME")] = None
    """removes the demonstration of this name"""
    watch: bool = False
    """watch a person with a camera"""
    camera: Annotated[str | None, unset("CAMERA")] = None
    """for --watch: number or address of a camera; a folder with the pictures of a film, or with such folders; or twin, where
    a simulated person does what the task's targets say"""
    calibration: Annotated[Path | None, unset("PATH")] = None
    """for --watch: lens and place of the camera, as python -m bt_jax.deploy calibrate writes them; the twin needs none, and
    films of --record tell their own"""
    fps: Annotated[float | None, unset("FLOAT")] = None
    """for --watch: pictures a second of a film whose pictures do not tell their times, or of the twin's"""
    idle: float = 6.0
    """for --watch with a camera: the demonstration ends once nothing has moved for this many seconds"""
    unclear: Literal["ask", "usual", "keep", "leave-out"] = "ask"
    """for --watch: what to do about a move that is in doubt; usual is what is suggested, also where nobody can be asked"""
    record: Annotated[Path | None, unset("PATH")] = None
    """for --watch: folder in which the pictures are kept, a folder for each film, which --camera can play again"""

    def check(self) -> None:
        """Raise UserError for arguments that cannot work."""
        if self.count < 1:
            raise UserError(f"--count is {self.count}; choose 1 or more")
        if (complaint := NOISE.complaint(self.noise)) is not None:
            raise UserError(f"--noise {complaint}")
        if self.seed is not None and self.seed < 0:
            raise UserError(f"--seed is {self.seed}; choose 0 or more")
        if self.script is not None and (self.rename or self.delete):
            raise UserError("--rename and --delete record nothing; leave out the script")
        self._check_watching()

    def _check_watching(self) -> None:
        defaults = DemonstrateArguments(self.folder)
        names = NOT_WATCHED if self.watch else WATCHED
        given = [
            f"--{name}" if name != "script" else "a script"
            for name in names
            if getattr(self, name) != getattr(defaults, name)
        ]
        if not self.watch:
            if given:
                raise UserError(f"{' and '.join(given)} {'is' if len(given) == 1 else 'are'} for watching; add --watch")
            return
        if given:
            raise UserError(f"--watch does not take {' and '.join(given)}; leave out what it does not take")
        if self.camera is None:
            raise UserError("--watch needs a camera; give --camera with a number, a folder with pictures, or twin")
        if self.camera != "twin" and not Path(self.camera).is_dir() and self.calibration is None:
            raise UserError(
                "--watch needs to know lens and place of the camera; give --calibration with the file that python -m "
                "bt_jax.deploy calibrate writes"
            )
        if self.fps is not None and not 0 < self.fps < 1000:
            raise UserError(f"--fps is {self.fps:g}; choose how many pictures were taken a second")
        if not 0 < self.idle <= 3600:
            raise UserError(f"--idle is {self.idle:g}; choose more than 0 seconds, and an hour at most")
