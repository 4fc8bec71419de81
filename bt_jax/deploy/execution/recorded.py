"""A run as its log tells it: what was known, decided and done, moment by moment, for people to look back at."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, expand, parse_behavior
from bt_jax.deploy.execution.log_reader import Damage, numbered_entries
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.robot.arrays import Joints
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.walk import prefix
from bt_jax.tasks import task_from_dict

__all__ = ["RecordedMoment", "RecordedRun", "program_of", "read_run", "statuses_of"]


@dataclasses.dataclass(frozen=True)
class RecordedMoment:
    """One tick: seconds since the run's beginning, what was known, the statuses of the nodes of the expanded tree when
    it was ticked last, what was done in a word, the action under way, the joints of each arm [rad] where they are told,
    and what else has happened since the moment before, each a clause."""

    time: float
    seen: Observation
    statuses: tuple[Status | None, ...]
    phase: str
    action: Behavior | None
    joints: Mapping[str, Joints]
    events: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class RecordedRun:
    """`seed` is that of the layout, None of a run that was not in the twin; `reason` says why it ended, "" if the log
    breaks off; `solved` whether it has reached its goal; `damaged` counts the lines that cannot be read."""

    program: Program
    moments: tuple[RecordedMoment, ...]
    seed: int | None
    reason: str
    solved: bool
    damaged: int


def program_of(start: Mapping[str, Any], source: Path) -> Program:
    """Return the program that a log was written for. Raise UserError if its digest does not fit its tree."""
    for key in ("task", "tree", "digest"):
        if key not in start:
            raise UserError(f"{source} lacks the {key}; give the log that a run has written")
    task = task_from_dict(start["task"], source=str(source), kept=True)
    program = Program(task, parse_tree(start["tree"]))
    if program.digest != start["digest"]:
        raise UserError(f"{source} was changed, its tree is not that of its digest; use the log as it was written")
    return program


def statuses_of(text: str) -> tuple[Status | None, ...]:
    """Return the statuses of a tick as the log has them."""
    return tuple(None if character == "." else Status(int(character)) for character in text)


def read_run(path: Path) -> RecordedRun:
    """Read a log; what is damaged is left out. Raise UserError if it is none, or tells no moment."""
    damage = Damage(path, strict=False)
    entries = numbered_entries(path, damage)
    _, start = next(entries)
    program = program_of(start, path)
    reader = _Reader(program, start)
    for number, entry in entries:
        with damage.noted(number):
            reader.take(entry)
    if not reader.moments:
        raise UserError(f"{path} tells no moment of a run; choose another log")
    settings, end = start.get("settings", {}), reader.end
    return RecordedRun(
        program,
        tuple(reader.moments),
        settings.get("seed") if settings.get("robot") == "twin" else None,
        str(end.get("reason", "")),
        end.get("exit_code") == 0,
        len(damage.lines),
    )


class _Reader:
    """Collects moments from the entries of a log, in their order."""

    def __init__(self, program: Program, start: Mapping[str, Any]) -> None:
        self.moments: list[RecordedMoment] = []
        self.end: Mapping[str, Any] = {}
        self._began: float = start.get("time", 0.0)
        self._statuses: tuple[Status | None, ...] = (None,) * len(prefix(expand(program.tree)))
        self._joints: dict[str, Joints] = {}
        self._events: list[str] = []

    def take(self, entry: Mapping[str, Any]) -> None:
        """Raise an error if the entry says something else than a run writes."""
        match entry["kind"]:
            case "tick":
                self._tick(entry)
            case "motion":
                self._joints = self._joints | _joints(entry)
            case "action":
                reason = f": {entry['reason']}" if entry["reason"] else ""
                self._events.append(f"{entry['action']} {entry['event']}{reason}")
            case "disturbance":
                self._events.append(f"{entry['what']} {entry['box']}")
            case "end":
                self.end = entry

    def _tick(self, entry: Mapping[str, Any]) -> None:
        seen, attempt = Observation.from_dict(entry["seen"]), entry["context"]["attempt"]
        if entry["statuses"] is not None:
            statuses = statuses_of(entry["statuses"])
            if len(statuses) != len(self._statuses):
                raise ValueError(f"{len(statuses)} statuses of {len(self._statuses)} nodes")
            self._statuses = statuses
        moment = RecordedMoment(
            seen.time - self._began,
            seen,
            self._statuses,
            entry["phase"],
            None if attempt is None else parse_behavior(attempt),
            self._joints,
            tuple(self._events),
        )
        self.moments.append(moment)
        self._events = []


def _joints(entry: Mapping[str, Any]) -> dict[str, Joints]:
    """Return where an arm was last in an entry about its motion: as measured, or as it was sent where that is unknown."""
    if not entry["measured"]:
        return {}
    measured = np.array(entry["measured"][-1], float)
    return {entry["arm"]: np.where(np.isfinite(measured), measured, np.array(entry["setpoint"][-1], float))}
