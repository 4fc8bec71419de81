"""What `python -m bt_jax.demonstrate` does: record demonstrations from a script; list, rename, delete them."""

from __future__ import annotations

import os
import re
import shlex
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax._util.startup import configure_jax
from bt_jax._util.text_files import read_text
from bt_jax.commands.arguments import DemonstrateArguments
from bt_jax.encoding.formats.files import check_tree, read_tree
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.lfd.clustering import NEEDED
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.tasks import Task, load_task, task_of_folder
from bt_jax.teaching.script import parse_script, record_one

__all__ = ["run"]

LISTED = 20  # layouts in an error


def run(arguments: DemonstrateArguments) -> None:
    """Record as the arguments say, and print what was recorded."""
    arguments.check()
    if arguments.watch:
        _watch(arguments)
        return
    console = Console(highlight=False, soft_wrap=True)
    folder = DemonstrationFolder(arguments.folder)
    if arguments.script is None:
        _edit(console, folder, arguments)
        return
    script = parse_script(_script_text(arguments.script))
    tree = None if arguments.after is None else read_tree(arguments.after)
    task = _task(arguments)
    if tree is not None and arguments.after is not None:
        check_tree(tree, task, arguments.after)
    configure_jax("cpu")
    physics = MujocoPhysics(task)
    seed = folder.next_layout() if arguments.seed is None else arguments.seed
    problems: dict[int, str] = {}
    recorded = 0
    for number in range(seed, seed + arguments.count):
        try:
            one = record_one(task, physics, script, number, noise=arguments.noise, after=tree)
        except UserError as error:
            problems[number] = str(error)
            continue
        if not recorded:
            folder.create(Frames.of(task))
            folder.use_layouts(seed + arguments.count)
            if arguments.after is not None and (arguments.after / "config.json").is_file():
                folder.remember_run(arguments.after)
        named = folder.append(one)
        recorded += 1
        console.print(f"{escape(str(folder.path / named.name))}: {len(named.actions)} actions")
    if not recorded:
        raise UserError(next(iter(problems.values())))
    total = len(folder.names())
    if total < NEEDED:
        frame = task.robot_frame
        console.print(
            f"{total} of {NEEDED} demonstrations: with fewer, every place but a slot is taken to be in {frame}"
        )
    console.print(f"learn from them with python -m bt_jax.learn {escape(shlex.quote(str(folder.path)))}")
    if problems:
        numbers = [str(number) for number in problems]
        listed = ", ".join(numbers[:LISTED]) + (f" and {len(numbers) - LISTED} others" if len(numbers) > LISTED else "")
        where = f"the layouts {listed}, first in " if len(problems) > 1 else ""
        raise UserError(
            f"{recorded} of {arguments.count} demonstrations {'is' if recorded == 1 else 'are'} kept; the script fails in "
            f"{where}{next(iter(problems.values()))}"
        )


def _watch(arguments: DemonstrateArguments) -> None:
    try:
        from bt_jax.commands.watch import watch  # OpenCV, which only the extra `robot` has
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[robot]"') from error
    watch(arguments)


def _task(arguments: DemonstrateArguments) -> Task:
    """Return the task to demonstrate in."""
    if arguments.task is not None:
        return load_task(arguments.task)
    after = arguments.after
    own = task_of_folder(after) if after is not None and after.is_dir() else None
    return own or DemonstrationFolder(arguments.folder).task() or load_task("stack3")


def _edit(console: Console, folder: DemonstrationFolder, arguments: DemonstrateArguments) -> None:
    """Rename or delete as the arguments say, and list what is there then."""
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
        handled = zip(one.actions, one.things(shown.frames), strict=True)
        things = ", ".join(thing for action, thing in handled if action.kind == "pick")
        console.print(f"[bold]{escape(one.name)}[/]: {len(one.actions)} actions, moves {escape(things)}")
    for problem in shown.problems:
        console.print(f"[yellow]{escape(problem)}[/]")


def _script_text(given: str) -> str:
    """Return the script itself, or the content of a file of that name."""
    if os.path.isfile(given) or re.fullmatch(r"[^;()]+\.\w+", given):  # long texts make Path.is_file raise
        return read_text(Path(given))
    return given
