"""python -m bt_jax.demonstrate: record demonstrations in simulation from a script of what the person does; keep them."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console
from rich.markup import escape

from bt_jax.behaviors import Tree, Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.errors import UserError
from bt_jax.lessons import baseline_from
from bt_jax.lfd import Demonstration, DemonstrationFolder, Frames
from bt_jax.lfd.clustering import NEEDED
from bt_jax.mjx_env.layouts import sample_layouts
from bt_jax.mjx_env.mujoco_backend import MujocoPhysics
from bt_jax.mjx_env.physics import Physics
from bt_jax.mjx_env.playback import play
from bt_jax.mjx_env.settling import Settler
from bt_jax.mjx_env.statuses import Semantics
from bt_jax.mjx_env.world import World
from bt_jax.run_folder import RunFolder
from bt_jax.startup import exit_code
from bt_jax.tasks import Task, load_task
from bt_jax.teleoperation import Teleoperation

__all__ = ["Arguments", "Input", "main", "parse_script", "perform", "record"]

DEMONSTRATED = 1 << 21  # seeds of layouts for demonstrations; neither training nor tests use them
_INPUT = re.compile(
    r"(?P<pick>pick)\s+(?P<object>\w+)|(?P<move>move)\s*\((?P<by>[^()]*)\)"
    r"|(?P<to>to)\s*\((?P<at>[^()]*)\)\s*(?P<frame>\w+)|(?P<release>release)"
)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Record demonstrations in simulation from a script, in the published format.

    A script is what the person at the gripper does, separated by semicolons or lines:
    pick BOX; move (DX, DY, DZ); to (X, Y, Z) FRAME; release. Metres; the box's centre counts.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FOLDER")]
    """folder of demonstrations; new ones are added"""
    script: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="SCRIPT")] = None
    """the script, for instance "pick BlueBox; to (0, 0, 0.12) GreenBox; release", or a file with one; without it, the
    demonstrations in the folder are listed"""
    task: str | None = None
    """name of a task or YAML file (default: that of --after, or stack3)"""
    count: int = NEEDED
    """how many demonstrations, each in another layout"""
    seed: int | None = None
    """number of the first layout (default: the number of demonstrations in the folder, so that each has another)"""
    noise: float = 0.0
    """standard deviation with which the person misses each place, along each axis, metres"""
    after: Path | None = None
    """run folder or tree that is executed first: the demonstration begins where it ends"""
    rename: tuple[str, str] | None = None
    """gives a demonstration another name: OLD NEW"""
    delete: str | None = None
    """removes the demonstration of this name"""

    def check(self) -> None:
        """Raises UserError for arguments that cannot work."""
        if self.count < 1:
            raise UserError(f"--count is {self.count}; choose 1 or more")
        if not 0 <= self.noise <= 0.1:
            raise UserError(f"--noise is {self.noise}; choose metres from 0 to 0.1")
        if self.seed is not None and self.seed < 0:
            raise UserError(f"--seed is {self.seed}; choose 0 or more")
        if self.script is not None and (self.rename or self.delete):
            raise UserError("--rename and --delete record nothing; leave out the script")


@dataclasses.dataclass(frozen=True)
class Input:
    """One thing that the person does; `position` is a vector in metres."""

    kind: str
    name: str = ""  # of the object for pick, of the frame for to
    position: tuple[float, ...] = (0.0, 0.0, 0.0)


def parse_script(text: str) -> list[Input]:
    """Reads a script. Raises UserError, naming the step, where it cannot be meant."""
    steps = [step.strip() for step in re.split(r"[;\n]", text) if step.split("#")[0].strip()]
    found = []
    for step in steps:
        match = _INPUT.fullmatch(step.split("#")[0].strip())
        if match is None:
            raise UserError(f"'{step}' is no step; write pick BOX, move (X, Y, Z), to (X, Y, Z) FRAME, or release")
        if match["pick"]:
            found.append(Input("pick", match["object"]))
        elif match["release"]:
            found.append(Input("release"))
        else:
            found.append(
                Input("to" if match["to"] else "move", match["frame"] or "", _vector(match["at"] or match["by"], step))
            )
    if not found:
        raise UserError("the script is empty; write for instance pick BlueBox; to (0, 0, 0.12) GreenBox; release")
    return found


def _vector(text: str, step: str) -> tuple[float, ...]:
    try:
        values = tuple(float(x) for x in text.split(","))
    except ValueError:
        values = ()
    if len(values) != 3 or not np.all(np.isfinite(values)):
        raise UserError(f"'{step}': ({text}) is not three numbers; write metres, as (0, 0, 0.12)")
    return values


def perform(
    session: Teleoperation, script: Sequence[Input], *, noise: float = 0.0, rng: np.random.Generator | None = None
) -> Demonstration:
    """Does what a script says in a session, missing each place by Gaussian `noise` [m], and returns the recording."""
    for step in script:
        off = rng.normal(0.0, noise, 3) if rng is not None and noise else np.zeros(3)
        match step.kind:
            case "pick":
                session.pick(step.name)
            case "move":
                session.move(np.array(step.position) + off)
            case "to":
                session.move_to(np.array(step.position) + off, step.name)
            case "release":
                session.release()
    return session.demonstration()


def record(
    task: Task,
    physics: Physics,
    script: Sequence[Input],
    *,
    count: int = NEEDED,
    seed: int = 0,
    noise: float = 0.0,
    after: Tree | None = None,
) -> list[Demonstration]:
    """Demonstrations of one script in `count` layouts, numbered from `seed`; the tree `after` is executed first in each."""
    found = []
    for number in range(seed, seed + count):
        start, rng = sample_layouts(task, [DEMONSTRATED, number], 1), np.random.default_rng([DEMONSTRATED, number])
        session = Teleoperation(task, physics, start if after is None else reached_by(after, task, physics, start))
        found.append(perform(session, script, noise=noise, rng=rng))
    return found


def reached_by(tree: Tree, task: Task, physics: Physics, start: World) -> World:
    """The state in which a tree ends. Raises UserError where it leaves something in the gripper."""
    semantics = Semantics(task, Vocabulary.of(leaves(tree)))
    final = play(semantics, Settler(task, physics), tree, start).final
    if final.held[0] >= 0:
        raise UserError("the tree ends with an object in the gripper; demonstrate from the start instead")
    return final


def main() -> None:
    """Entry point of the command line."""
    arguments = tyro.cli(Arguments, prog="python -m bt_jax.demonstrate")
    sys.exit(exit_code(lambda: run(arguments)))


def run(arguments: Arguments) -> None:
    """Records as the arguments say and prints what came of it."""
    arguments.check()
    console = Console(highlight=False, soft_wrap=True)
    folder = DemonstrationFolder(arguments.folder)
    if arguments.script is None:
        _keep_house(console, folder, arguments)
        return
    script = parse_script(_script_text(arguments.script))
    tree, task = None, load_task(arguments.task or "stack3")
    if arguments.after is not None:
        tree = baseline_from(arguments.after)
        if arguments.task is None and (arguments.after / "config.json").is_file():
            task = RunFolder(arguments.after).config().task
    physics = MujocoPhysics(task, why="the C engine")
    seed = arguments.seed
    if seed is None:
        seed = len(folder.names()) if folder.path.is_dir() else 0
    recorded = record(task, physics, script, count=arguments.count, seed=seed, noise=arguments.noise, after=tree)
    folder.create(Frames.of(task))
    for demonstration in recorded:
        named = folder.append(demonstration)
        console.print(f"{escape(str(folder.path / named.name))}: {len(named.actions)} actions")
    total = len(folder.names())
    if total < NEEDED:
        console.print(
            f"{total} of {NEEDED} demonstrations: with fewer, every place is taken to be in {task.robot_frame}"
        )
    named = "" if task.name == "stack3" else f" --task {arguments.task or task.name}"
    console.print(f"learn from them with python -m bt_jax.learn {escape(str(folder.path))}{named}")


def _keep_house(console: Console, folder: DemonstrationFolder, arguments: Arguments) -> None:
    """Renames or deletes as the arguments say, and lists what is there then."""
    folder.frames()
    if arguments.rename is not None:
        folder.rename(*arguments.rename)
    if arguments.delete is not None:
        folder.delete(arguments.delete)
    if not folder.names():
        console.print(f"{escape(str(folder.path))} holds no demonstration")
        return
    shown = folder.read()
    for one in shown:
        things = ", ".join(action.nearest(shown.frames.objects) for action in one.actions if action.kind == "pick")
        console.print(f"[bold]{escape(one.name)}[/]: {len(one.actions)} actions, moves {escape(things)}")
    for problem in shown.problems:
        console.print(f"[yellow]{escape(problem)}[/]")


def _script_text(given: str) -> str:
    """The script itself, or what stands in a file of that name."""
    path = Path(given)
    try:
        if not re.fullmatch(r"\S+\.\w+", given):
            return given
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(
            f"the script {path} cannot be read ({error}); check its name, or write the steps themselves"
        ) from None


if __name__ == "__main__":
    main()
