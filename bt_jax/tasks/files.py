"""Tasks as YAML files, each of which may name another one in `extends` and only say what differs.

Everything is inherited but the description, which is empty unless the task has its own.
"""

from __future__ import annotations

import dataclasses
import difflib
import json
import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import yaml

from bt_jax._util.errors import UserError
from bt_jax.tasks.checks import check
from bt_jax.tasks.task import Box, Episode, GeneSettings, Kit, Layout, Subgoal, Table, Target, Task, Weights

__all__ = ["load_task", "task_from_dict", "task_names", "task_of_folder"]

FOLDER = Path(__file__).parent
SUBGOALS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {"unstacked": ("holding(nothing)", "reachable({box})", "clear({box})")}  # every box rests on a table or in the kit
)


def task_names() -> list[str]:
    """Return the names of the tasks that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.yaml"))


def load_task(name_or_path: str | Path) -> Task:
    """Read a task by name (one of `task_names()`) or from a YAML file.

    Raise UserError, naming file, key and remedy, if the task is invalid.
    """
    path = _find(name_or_path)
    return task_from_dict(_read(path), source=str(path))


def task_of_folder(folder: Path) -> Task | None:
    """Return the task that a folder of `train`, `learn` or `demonstrate` belongs to, None if it does not say.

    Raise UserError if what it says cannot be read.
    """
    config, own = folder / "config.json", folder / "task.yaml"
    if not config.is_file():
        return load_task(own) if own.is_file() else None
    try:
        data = json.loads(config.read_text(encoding="utf-8"))["task"]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"{config} cannot be read ({error}); restore it, or name the task with --task") from error
    return task_from_dict(data, source=str(config))


def task_from_dict(data: Any, *, source: str) -> Task:
    """Build a task from a mapping as in the YAML files and check it; `source` is named in errors."""
    if not isinstance(data, Mapping):
        raise UserError(f"{source}: the task must be a mapping, found {data!r}; see bt_jax/tasks/stack.yaml")
    data = {"description": "", **data}
    data.pop("extends", None)
    if isinstance(data.get("subgoals"), list | tuple):
        data["subgoals"] = [_subgoal(entry, source) for entry in data["subgoals"]]
    task = _build(Task, data, source, "")
    check(task, source)
    return task


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
        if path.is_file():
            return path
        raise UserError(f"there is no task file {path}; check the path, or name one of: {', '.join(task_names())}")
    raise UserError(f"unknown task '{text}'; choose one of {', '.join(task_names())}, or give a .yaml file with --task")


def _read(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path} cannot be read ({error}); check its name and permissions") from error
    except yaml.YAMLError as error:
        where = getattr(error, "problem_mark", None)
        line = f", line {where.line + 1}" if where else ""
        raise UserError(
            f"{path}{line} is not valid YAML ({getattr(error, 'problem', error)}); fix that line"
        ) from error
    if not isinstance(data, dict):
        raise UserError(f"{path} must be a mapping with keys such as boxes and targets; see bt_jax/tasks/stack.yaml")
    if "extends" not in data:
        return data
    path = path.resolve()
    base = _find(data["extends"]) if str(data["extends"]) in task_names() else path.parent / str(data["extends"])
    base = base.resolve()
    if not base.is_file() or base in (*seen, path):
        raise UserError(
            f"{path}, key extends: '{data['extends']}' is not another task; name one of {', '.join(task_names())}"
        )
    inherited = _read(base, (*seen, path))
    inherited.pop("description", None)  # it describes the base
    return _merge(inherited, data)


def _merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    merged = dict(base)
    for key, value in over.items():
        both_maps = isinstance(value, dict) and isinstance(base.get(key), dict)
        merged[key] = _merge(base[key], value) if both_maps else value
    return merged


_NESTED = {cls.__name__: cls for cls in (Table, Kit, Box, Target, Layout, GeneSettings, Episode, Weights, Subgoal)}


def _build(cls: type, data: Any, source: str, where: str) -> Any:
    if not isinstance(data, Mapping):
        raise UserError(f"{source}, key {where}: expected a mapping, found {data!r}; see bt_jax/tasks/stack.yaml")
    fields = {field.name: field for field in dataclasses.fields(cls)}
    for key in data:
        if key not in fields:
            near = difflib.get_close_matches(str(key), fields, n=1)
            remedy = f"did you mean {near[0]}?" if near else f"use one of {', '.join(fields)}"
            raise UserError(f"{source}, key {where}{key}: not known here; {remedy}")
    for field in fields.values():
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if required and field.name not in data:
            raise UserError(f"{source}, key {where}{field.name}: missing; add it")
    return cls(**{key: _value(fields[key], value, source, f"{where}{key}") for key, value in data.items()})


def _value(field: dataclasses.Field, value: Any, source: str, where: str) -> Any:
    kind = str(field.type)
    if kind in _NESTED:
        return _build(_NESTED[kind], value, source, f"{where}.")
    item = _NESTED.get(kind.removeprefix("tuple[").removesuffix(", ...]"))
    if item is None:
        return _scalar(kind, value, source, where)
    if not isinstance(value, list):
        raise UserError(f"{source}, key {where}: expected a list, found {value!r}; write one '- ' entry for each")
    return tuple(_build(item, entry, source, f"{where}[{i}].") for i, entry in enumerate(value))


def _scalar(kind: str, value: Any, source: str, where: str) -> Any:
    if kind == "float":
        return _number(value, source, where)
    if kind == "int":
        if not _number(value, source, where).is_integer():
            raise UserError(f"{source}, key {where}: expected a whole number, found {value!r}; write one such as 10")
        return int(value)
    if kind == "Vec3":
        if not isinstance(value, list | tuple) or len(value) != 3:
            raise UserError(
                f"{source}, key {where}: expected three numbers, found {value!r}; write [x, y, z], such as [0.1, 0, 0.05]"
            )
        return tuple(_number(x, source, where) for x in value)
    if kind.startswith("tuple"):
        if not isinstance(value, list | tuple) or not all(isinstance(x, str) for x in value):
            raise UserError(
                f"{source}, key {where}: expected a list of names, found {value!r}; write one such as [YellowBox]"
            )
        return tuple(value)
    if not isinstance(value, str):
        raise UserError(f"{source}, key {where}: expected a name, found {value!r}; write one such as YellowBox")
    return value


def _number(value: Any, source: str, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise UserError(f"{source}, key {where}: expected a number, found {value!r}; write one such as 0.05")
    return float(value)
