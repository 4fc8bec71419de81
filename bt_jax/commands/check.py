"""What `python -m bt_jax.check` does: read files and folders with the readers of the other commands, and say what each is
or what is wrong with it."""

from __future__ import annotations

import contextlib
import os
import re
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

from rich.console import Console
from rich.markup import escape

from bt_jax._util.errors import UserError
from bt_jax._util.text_files import read_text
from bt_jax._util.words import counted
from bt_jax._util.yaml_files import read_yaml
from bt_jax.behaviors import Tree, subgoal_conditions
from bt_jax.commands.arguments import CheckArguments
from bt_jax.encoding.formats.files import LEARNT, check_tree, read_tree
from bt_jax.encoding.walk import prefix
from bt_jax.lfd import DemonstrationFolder
from bt_jax.lfd.demonstration_files import read_demonstration
from bt_jax.lfd.demonstration_info import REBUILT, is_described
from bt_jax.tasks import load_task, task_of_folder
from bt_jax.teaching.kit_file import LARGEST, SUFFIX, KitFile
from bt_jax.teaching.script import parse_script
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import read_note

__all__ = ["described", "run"]

KNOWN = (
    "a task (.yaml), a folder of demonstrations, a tree (.txt, .xml), a folder of train or learn, a kit (.kit.zip), a "
    "calibration file (.yaml) or a log of the robot (.jsonl)"
)
CONFIG = re.compile(r"config(-\d+)?\.json")


def run(arguments: CheckArguments, console: Console | None = None) -> int:
    """Check what the arguments name, print one line for each, and return the exit code: 2 if anything is wrong."""
    arguments.check()
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    wrong = 0
    for path in arguments.files:
        for one in _parts(path):
            try:
                console.print(f"[green]fine[/] {escape(str(one))}: {escape(described(one))}")
            except UserError as error:
                wrong += 1
                print(f"error: {error}", file=sys.stderr)
    return 2 if wrong else 0


def described(path: Path) -> str:
    """Return what a file or folder is, and a summary. Raise UserError if it is of no kind that is known, or invalid."""
    try:
        if not path.exists():
            raise UserError(f"there is no file or folder {path}; check the path")
        kind = _kind_of_folder(path) if path.is_dir() else _reader(path)
        if kind is None:
            raise UserError(f"{path} is nothing that can be checked; give {KNOWN}")
        return kind(path)
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror}); check its name and permissions") from error


def _parts(path: Path, seen: set[str] | None = None) -> Iterator[Path]:
    """Yield the path itself; of a folder that is nothing in itself, what it holds. `seen`: folders with links followed, each
    of which is entered once, for a link may lead back to where it stands."""
    seen = set() if seen is None else seen
    inner = []
    with contextlib.suppress(OSError):  # then reading it says why
        inner = sorted(path.iterdir()) if path.is_dir() and _kind_of_folder(path) is None else []
    seen.add(os.path.realpath(path))
    held = [one for one in inner if not one.name.startswith(".") and (one.is_dir() or _reader(one) is not None)]
    if not held:
        yield path
    for one in held:
        if not one.is_dir() or os.path.realpath(one) not in seen:
            yield from _parts(one, seen)


def _reader(path: Path) -> Callable[[Path], str] | None:
    if path.name.endswith(SUFFIX):
        return _kit
    return _config if CONFIG.fullmatch(path.name) else READERS.get(path.suffix.lower())


def _kind_of_folder(path: Path) -> Callable[[Path], str] | None:
    if (path / "config.json").exists():
        return _run_folder
    if any((path / name).exists() for name in LEARNT):
        return _learnt
    if (path / "info.yaml").exists() or next(path.glob("*/data_*.yaml"), None) is not None:
        return _demonstrations
    return None


def _run_folder(path: Path) -> str:
    folder = RunFolder(path)
    config, checkpoint = folder.config(), folder.load_checkpoint()
    subgoal_conditions(config.task, source=str(path / "config.json"))
    generation = "not begun" if checkpoint is None else f"generation {int(checkpoint.state.generation)}"
    tree = "no tree yet"
    if (path / LEARNT[0]).exists():
        learnt = folder.tree()
        check_tree(learnt, config.task, path / LEARNT[0])
        tree = _tree_summary(learnt)
    named = f' "{name}"' if (name := read_note(path).name) else ""
    return f"run folder{named}, task {config.task.name}, {generation}, {tree}"


def _learnt(path: Path) -> str:
    tree, task = read_tree(path), task_of_folder(path)
    if task is None:
        return f"folder of a learnt tree, {_tree_summary(tree)}"
    check_tree(tree, task, path)
    return f"folder of a learnt tree, task {task.name}, {_tree_summary(tree)}"


def _demonstrations(path: Path) -> str:
    folder = DemonstrationFolder(path)
    if not folder.names():
        folder.frames()
        return "folder of demonstrations, empty"
    folder.task()
    read, lost = folder.read(), not is_described(path)
    problems = read.problems[1:] if lost else read.problems
    if problems:
        more = f" (and {counted(len(problems) - 1, 'problem')} more)" if len(problems) > 1 else ""
        raise UserError(f"{path}: {problems[0].removesuffix('.')}{more}")
    actions = counted(sum(len(one.actions) for one in read), "action")
    note = f"; info.yaml is missing or empty, {REBUILT}" if lost else ""
    return f"folder of demonstrations, {counted(len(read), 'demonstration')}, {actions}{note}"


def _yaml(path: Path) -> str:
    if path.name == "info.yaml":
        return _demonstrations(path.parent)
    data = read_yaml(path)
    keys = set(data) if isinstance(data, Mapping) else set()
    if keys & {"vec_pos", "vec_quat"}:
        one = read_demonstration(path.parent, DemonstrationFolder(path.parent.parent).frames())
        return f"action of demonstration {one.name}, {counted(len(one.actions), 'action')}"
    if keys & {"intrinsics", "pose_in_base"}:
        return _camera(path, located="pose_in_base" in keys)
    if keys and all(isinstance(key, int) for key in keys):
        return _points(path)
    task = load_task(path)
    subgoal_conditions(task, source=str(path))
    return f"task {task.name}, {counted(len(task.objects), 'object')}, {counted(len(task.targets), 'target')}"


def _camera(path: Path, *, located: bool) -> str:
    with _needs_robot():
        from bt_jax.deploy.perception.camera_file import load_camera, load_intrinsics  # heavy: OpenCV
    lens = load_camera(path)[0] if located else load_intrinsics(path)
    place = "with its place in the robot's base" if located else "lens only"
    return f"calibration file, {lens.width} x {lens.height} px, error {lens.error:.2g} px, {place}"


def _points(path: Path) -> str:
    with _needs_robot():
        from bt_jax.deploy.perception.camera_file import load_points  # heavy: OpenCV
    return f"places of markers, {counted(len(load_points(path)), 'marker')}"


def _log(path: Path) -> str:
    with _needs_robot():
        from bt_jax.deploy.execution.log_reader import read_log
        from bt_jax.deploy.execution.recorded import program_of  # heavy: only the robot needs these
    entries = read_log(path)
    program = program_of(next(entries), path)
    kinds = [entry["kind"] for entry in entries]
    end = "" if "end" in kinds else ", breaks off"
    return f"log of the robot, task {program.task.name}, {counted(kinds.count('tick'), 'tick')}{end}"


def _text(path: Path) -> str:
    text = read_text(path)
    if re.match(r"(\s|#.*\n)*pick\s+\w", text):
        return f"script of a demonstration, {counted(len(parse_script(text)), 'step')}"
    return f"tree, {_tree_summary(read_tree(path))}"


def _xml(path: Path) -> str:
    return f"tree in XML, {_tree_summary(read_tree(path))}"


def _kit(path: Path) -> str:
    if path.stat().st_size > LARGEST:
        raise UserError(f"{path} is larger than any kit; give one that the page has saved")
    kit = KitFile.unpack(path.read_bytes(), str(path))
    sets, trees = counted(len(kit.sets), "set"), counted(len(kit.trees), "tree")
    return f"kit, task {kit.task.name}, {sets} of demonstrations, {trees}"


def _config(path: Path) -> str:
    config = RunConfig.read(path)
    return f"configuration of a run, task {config.task.name}, population {config.gp.population}"


def _checkpoint(path: Path) -> str:
    checkpoint = Checkpoint.load(path)
    if checkpoint is None:  # deleted meanwhile
        raise UserError(f"there is no file {path}; check the path")
    return f"checkpoint, generation {int(checkpoint.state.generation)}"


@contextlib.contextmanager
def _needs_robot() -> Iterator[None]:
    """Say how to install what only the robot needs, if it is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise UserError(f'{error.name} is not installed; run pip install -e ".[robot]"') from error


def _tree_summary(tree: Tree) -> str:
    return counted(len(prefix(tree)), "node")


READERS: Mapping[str, Callable[[Path], str]] = MappingProxyType(
    {
        ".yaml": _yaml, ".yml": _yaml, ".txt": _text, ".xml": _xml, ".npz": _checkpoint, ".jsonl": _log
    }
)  # fmt: skip
