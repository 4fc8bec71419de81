"""What a run writes to its log: what was run, every tick with the motion since the last one, and how it ended."""

from __future__ import annotations

import contextlib
import dataclasses
from typing import Any

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.log import FORMAT, Log, versions
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.outcome import Halt, Limits, Outcome
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.statuses import Context
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.encoding.formats.text import one_line
from bt_jax.encoding.interpret import TreeTick

__all__ = ["RunLog"]

RECORD_EVERY = 5  # of the link's cycles, one is logged; all of the last ones before a stop


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

    def tick(self, seen: Observation, context: Context, ticked: TreeTick | None, phase: str, took: float) -> None:
        """`took` seconds; `ticked` None where the tree was not asked."""
        statuses = None if ticked is None else ticked.statuses
        self.log.write(
            "tick",
            seen=seen.to_dict(),
            context={
                "attempt": None if context.attempt is None else str(context.attempt),
                "exhausted": sorted(map(str, context.exhausted)),
                "reached": sorted(context.reached),
                "unreachable": sorted(context.unreachable),
            },
            statuses=None if statuses is None else "".join("." if s is None else str(int(s)) for s in statuses),
            phase=phase,
            took=round(took, 4),
        )
        self._motion(RECORD_EVERY)

    def last_motion(self, end: Halt) -> None:
        """Every cycle where the arms had to hold."""
        with contextlib.suppress(UserError):
            self._motion(1 if end.holds else RECORD_EVERY)

    def end(self, outcome: Outcome, time: float) -> None:
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
