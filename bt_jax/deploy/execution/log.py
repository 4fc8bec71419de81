"""The log of a run: one JSON object a line, written as it happens, so that a crash loses nothing.

`start` says what was run (tree and its digest, task, settings, versions), `tick` what was known and what each node
returned, `action` when an attempt began and how it ended, `motion` setpoints and feedback, `end` why it was over.
"""

from __future__ import annotations

import contextlib
import dataclasses
import importlib.metadata
import json
import math
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.decision import Decision, Look
from bt_jax.deploy.execution.observation import Observation, pose_to_list
from bt_jax.deploy.execution.outcome import Halt, RunOutcome
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.execution.statuses import Context
from bt_jax.deploy.link.protocol import Records, RobotLink
from bt_jax.deploy.robot.arrays import JointRows
from bt_jax.encoding.formats.text import one_line

__all__ = ["FORMAT", "Log", "RunLog", "TickEntry", "versions"]

FORMAT = 1
DIGITS = 5  # of joints in `motion`, rad
RECORD_EVERY = 5  # of the link's cycles, one is logged; all of the last ones before a stop


def versions() -> dict[str, str]:
    """Return the versions of everything that affects what the robot does; absent packages are left out."""
    found = {"python": platform.python_version()}
    for name in ("bt_jax", "mujoco", "numpy", "scipy", "pin", "opencv-python-headless", "protobuf"):
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


class Log:
    """Writes a log; without a path, nowhere. Use it as a context manager."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self._file = None
        if path is None:
            return
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("x", encoding="utf-8")
        except FileExistsError as error:
            raise UserError(f"{path} exists already; choose another name for the log") from error
        except OSError as error:
            raise UserError(f"{path} cannot be written ({error.strerror}); choose another place for the log") from error

    def __enter__(self) -> Log:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, kind: str, **fields: Any) -> None:
        """Add a line and hand it to the system at once."""
        if self._file is None:
            return
        self._file.write(json.dumps({"kind": kind, **fields}, allow_nan=False, default=_plain) + "\n")
        self._file.flush()

    def motion(self, arms: tuple[str, ...], records: Records, *, every: int) -> None:
        """Write setpoints and feedback, of each arm every n-th cycle by sequence number."""
        for index, arm in enumerate(arms):
            rows = records[records[:, 0] == index]
            rows = rows[rows[:, -1] % every == 0]
            if len(rows):
                self.write("motion", arm=arm, time=rows[:, 1].round(4).tolist(), **_joints(rows))

    def close(self) -> None:
        """Make sure that everything is on the disk."""
        if self._file is not None and not self._file.closed:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()


@dataclasses.dataclass(frozen=True)
class TickEntry:
    """One tick for the log. `look`, `sight` in the file, is that before the tick; `decision` is None where the tree was not
    ticked."""

    time: float  # s
    seen: Observation
    context: Context
    look: Look
    decision: Decision | None
    phase: str
    took: float  # s


class RunLog:
    """Writes the entries of one run."""

    def __init__(self, log: Log, link: RobotLink) -> None:
        self.log, self.link = log, link

    def start(self, program: Program, time: float, limits: Limits, settings: dict[str, Any], dry: bool) -> None:
        self.log.write(
            "start",
            format=FORMAT,
            time=time,
            tree=one_line(program.tree),
            digest=program.digest,
            task=program.task.to_dict(),
            limits=dataclasses.asdict(limits),
            settings=settings,
            dry=dry,
            versions=versions(),
        )

    def tick(self, entry: TickEntry) -> None:
        """Write a tick, and the motion since the one before."""
        context, look, decision = entry.context, entry.look, entry.decision
        statuses = None if decision is None else decision.ticked.statuses
        hidden = {name: pose for name, pose in (context.last or {}).items() if name not in entry.seen.poses}
        self.log.write(
            "tick",
            time=entry.time,
            seen=entry.seen.to_dict(),
            context={
                "attempt": None if context.attempt is None else str(context.attempt),
                "exhausted": sorted(map(str, context.exhausted)),
                "reached": sorted(context.reached),
                "unreachable": sorted(context.unreachable),
                "last": {name: pose_to_list(pose) for name, pose in hidden.items()},
            },
            sight={
                "looking": look.looking,
                "looked": look.looked,
                "undecided": sorted(map(str, look.undecided)),
            },
            statuses=None if statuses is None else "".join("." if s is None else str(int(s)) for s in statuses),
            phase=entry.phase,
            took=round(entry.took, 4),
        )
        self._motion(RECORD_EVERY)

    def last_motion(self, end: Halt) -> None:
        """Write the rest of the motion: every cycle if the arms had to hold."""
        with contextlib.suppress(UserError):
            self._motion(1 if end.holds else RECORD_EVERY)

    def end(self, outcome: RunOutcome, time: float) -> None:
        self.log.write(
            "end",
            time=time,
            **{**dataclasses.asdict(outcome), "status": outcome.status.name},
            counters=dataclasses.asdict(self.link.counters()),
        )

    def _motion(self, every: int) -> None:
        drain = getattr(self.link, "drain", None)
        if drain is not None:
            self.log.motion(self.link.arms, drain(), every=every)


def _joints(rows: Records) -> dict[str, list]:
    setpoint, measured = np.split(rows[:, 2:-1], 2, axis=1)
    return {"setpoint": _numbers(setpoint), "measured": _numbers(measured)}


def _numbers(rows: JointRows) -> list[list[float | None]]:
    """Return joints for JSON: null for a measurement that is not a number."""
    return [[value if math.isfinite(value) else None for value in row] for row in rows.round(DIGITS).tolist()]


def _plain(value: Any) -> Any:
    """Convert what JSON does not know by itself."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    return str(value)
