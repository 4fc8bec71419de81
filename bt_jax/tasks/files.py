"""Tasks as YAML files, each of which may name another one in `extends` and only say what differs.

Everything is inherited but the description, which is empty unless the task has its own, and the height of genes on the grid,
if the task has its own objects.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import is_name
from bt_jax._util.json_files import read_json
from bt_jax._util.yaml_files import parse_yaml, read_yaml
from bt_jax.tasks.base_checks import with_drives
from bt_jax.tasks.checks import check, check_support
from bt_jax.tasks.task import Task
from bt_jax.tasks.written import WrittenTask, merged

__all__ = ["load_task", "parse_task", "task_from_dict", "task_names", "task_of_folder"]

FOLDER = Path(__file__).parent
SUBGOALS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"unstacked": ("holding(nothing)", "reachable({box})", "clear({box})")}  # every box rests on a table or in the kit
)

BASES = FOLDER / "bases"  # what tasks extend, and no tasks themselves
BEFORE: Mapping[str, str] = MappingProxyType({"subgoal_reward": "seen"})  # key -> what holds where it is not kept

EXAMPLES: Mapping[str, str] = MappingProxyType(
    {  # key -> what to write for it
        "name": "YellowBox",
        "position": "[0, 0, 0.05]",
        "size": "0.05",
        "color": "[0.9, 0.7, 0.1]",
        "object": "YellowBox",
        "frame": "KittingBox",
        "reach": "0.9",
        "conditions": "[clear(YellowBox)]",
        "tables": "[{name: Left, position: [-0.4, 0, 0.35], size: [0.6, 0.6, 0.7]}]",
        "targets": "[{object: YellowBox, position: [0, 0, 0.03], frame: KittingBox}]",
    }
)


def task_names() -> list[str]:
    """Return the names of the tasks that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_task(name_or_path: str | Path, *, unfinished: bool = False) -> Task:
    """Read a task by name (one of `task_names()`) or from a YAML file; an unfinished one may have what `problems` finds.

    Raise UserError, naming file, key and remedy, if the task is invalid.
    """
    path = _find(name_or_path)
    task = task_from_dict(_read(path), source=str(path), unfinished=unfinished)
    if not unfinished:
        check_support(task, str(path))
    return task


def parse_task(text: str, *, source: str, unfinished: bool = False) -> Task:
    """Build a task from the text of a file, which may extend what comes with the package, but no other file.

    An unfinished one may have what `problems` finds. Raise UserError, naming `source`, key and remedy, if it is invalid.
    """
    data = _mapping(parse_yaml(text, source), source)
    if "extends" in data:
        base = next((file for file in _packaged(str(data["extends"])) if _is_file(file)), None)
        if base is None:
            problem = f"'{data['extends']}' does not come with the package"
            raise UserError(f"{source}, key extends: {problem}; name one of {', '.join(task_names())}")
        data = _extended(_read(base), data)
    task = task_from_dict(data, source=source, unfinished=unfinished)
    if not unfinished:
        check_support(task, source)
    return task


def task_of_folder(folder: Path) -> Task | None:
    """Return the task that a folder of `train`, `learn` or `demonstrate` belongs to, None if it does not say.

    Raise UserError if what it says cannot be read.
    """
    config, own = folder / "config.json", folder / "task.yaml"
    if not config.is_file():
        return task_from_dict(_read(own), source=str(own), kept=True) if own.is_file() else None
    try:
        data = read_json(config)["task"]
    except (KeyError, TypeError) as error:
        raise UserError(f"{config} says no task; restore it, or name the task with --task") from error
    return task_from_dict(data, source=str(config), kept=True)


def task_from_dict(data: Any, *, source: str, kept: bool = False, unfinished: bool = False) -> Task:
    """Build a task from a mapping as in the YAML files and check it; `source` is named in errors. An unfinished one may have
    what `problems` finds.

    If the program has `kept` it, in a run folder, a log or a draft, a key that it lacks means what held before there was
    that key.
    """
    if not isinstance(data, Mapping):
        raise UserError(f"{source}: the task must be a mapping, found {data!r}; see bt_jax/tasks/stack.yaml")
    data = {"description": "", **(BEFORE if kept else {}), **data}
    data.pop("extends", None)
    if isinstance(data.get("subgoals"), list | tuple):
        data["subgoals"] = [_subgoal(entry, source) for entry in data["subgoals"]]
    episode = data.get("episode")
    written = decode(_without_keywords(data), WrittenTask, source, examples=EXAMPLES)
    ticks_given = isinstance(episode, Mapping) and "max_ticks" in episode
    task, keys = written.task(source, ticks_given=ticks_given)
    check(task, source, keys, unfinished=unfinished)
    return with_drives(task, ticks_given=ticks_given)


def _without_keywords(data: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a task's mapping with `takes` for the `for` of its slots, which no field can be called."""

    def renamed(slot: Any) -> Any:
        return (
            {"takes" if key == "for" else key: value for key, value in slot.items()} if isinstance(slot, dict) else slot
        )

    def of_kit(kit: Any) -> Any:
        slots = kit.get("slots") if isinstance(kit, dict) else None
        return {**kit, "slots": [renamed(slot) for slot in slots]} if isinstance(slots, list | tuple) else kit

    kits = data.get("kits")
    several = {"kits": [of_kit(kit) for kit in kits]} if isinstance(kits, list | tuple) else {}
    return {**data, **several, **({"kit": of_kit(data["kit"])} if "kit" in data else {})}


def _subgoal(entry: Any, source: str) -> Any:
    """Return a subgoal that is only named is one of those that every task knows."""
    if not isinstance(entry, str):
        return entry
    if entry not in SUBGOALS:
        known = ", ".join(SUBGOALS)
        raise UserError(
            f"{source}, key subgoals: '{entry}' is unknown; use one of {known}, or give a name with conditions"
        )
    return {"name": entry, "conditions": list(SUBGOALS[entry])}


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text in task_names():
        return FOLDER / f"{text}.yaml"
    path = Path(text)
    if path.suffix in (".yaml", ".yml"):
        if _is_file(path):
            return path
        raise UserError(f"there is no task file {path}; check the path, or name one of: {', '.join(task_names())}")
    raise UserError(f"unknown task '{text}'; choose one of {', '.join(task_names())}, or give a .yaml file with --task")


def _is_file(path: Path) -> bool:
    """Return whether there is such a file; a name that cannot be one is none."""
    with contextlib.suppress(OSError, ValueError):
        return path.is_file()
    return False


def _packaged(name: str) -> list[Path]:
    """Return the files that a task of the package, or a base of tasks, may be in; none for what is no name."""
    return [folder / f"{name}.yaml" for folder in (FOLDER, BASES)] if is_name(name) else []


def _base(name: str, path: Path) -> Path:
    """Return the file that a task extends: a task or a base of the package, or a file beside it."""
    return next((file for file in _packaged(name) if _is_file(file)), path.parent / name)


def _mapping(data: Any, source: object) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise UserError(
            f"{source} must be a mapping with keys such as objects and targets; see bt_jax/tasks/stack.yaml"
        )
    return data


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    data = _mapping(read_yaml(path), path)
    if "extends" not in data:
        return data
    path = path.resolve()
    base = _base(str(data["extends"]), path).resolve()
    if not _is_file(base) or base in (*seen, path):
        raise UserError(
            f"{path}, key extends: '{data['extends']}' is not another task; name one of {', '.join(task_names())}"
        )
    return _extended(_read(base, (*seen, path)), data)


def _extended(inherited: dict[str, Any], data: dict[str, Any]) -> dict[str, Any]:
    """Return what a file says together with what it inherits."""
    inherited.pop("description", None)  # it describes the base
    genes = inherited.get("genes")
    if isinstance(genes, dict) and ("objects" in data or "boxes" in data):
        genes.pop("height", None)  # of the base's objects
    return merged(inherited, data)
