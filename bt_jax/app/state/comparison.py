"""In what runs differ, so that their results can be compared: the settings that are not the same in all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from bt_jax.app.plain_words import Words
from bt_jax.app.state.run_record import RunRecord
from bt_jax.tasks import Task
from bt_jax.training.run_config import RunConfig

__all__ = ["Difference", "differences"]


@dataclasses.dataclass(frozen=True)
class Difference:
    """A setting, and its value in each of the runs."""

    name: str
    values: tuple[str, ...]


def differences(records: Sequence[RunRecord]) -> list[Difference]:
    """Return what is not the same in all of the runs, in the order of the settings."""
    said = [_settings(record.config) for record in records]
    rows = [Difference(name, tuple(one.get(name, "") for one in said)) for name in said[0]] if said else []
    return [row for row in rows if len(set(row.values)) > 1]


def _settings(config: RunConfig) -> dict[str, str]:
    """Return everything that was chosen for a run, by what it is called."""
    gp, simulation = dataclasses.asdict(config.gp), dataclasses.asdict(config.settings)
    return {
        "task": config.task.name,
        "goal": _goal(config.task),
        "starts": "in fixed places" if config.task.layout.fixed else "at random",
        "what goes wrong": _faults(config.task),
        "started from": "a tree" if config.baseline is not None else "nothing",
        "times taught": str(config.phase),
        **{name.replace("_", " "): _value(value) for name, value in {**gp, **simulation}.items()},
        "version": config.version,
    }


def _goal(task: Task) -> str:
    words = Words(task)
    return "; ".join(f"{target.object} {words.target(target)}" for target in task.targets)


def _faults(task: Task) -> str:
    chances = {} if task.faults is None else dataclasses.asdict(task.faults)
    return ", ".join(f"{name} {_value(value)}" for name, value in chances.items() if value) or "nothing"


def _value(value: Any) -> str:
    if value is None:
        return "by itself"
    return f"{value:g}" if isinstance(value, float) else str(getattr(value, "value", value)).replace("_", " ")
