"""What the caller of a run gets: each tick as it happens, and how the run ended."""

from __future__ import annotations

import dataclasses

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.settings import Exit
from bt_jax.encoding.status import Status

__all__ = ["Halt", "RunOutcome", "TickReport"]


@dataclasses.dataclass(frozen=True)
class RunOutcome:
    """How a run ended; `status` is RUNNING if it was stopped."""

    status: Status
    reason: str
    exit_code: int
    seconds: float
    ticks: int
    overruns: int  # ticks that took longer than they may


@dataclasses.dataclass(frozen=True)
class TickReport:
    """One tick, for displays; `statuses` of the nodes of the expanded tree, None where the tree was not ticked."""

    seen: Observation
    statuses: tuple[Status | None, ...] | None
    action: Behavior | None
    phase: str


class Halt(Exception):
    """The run is over: `reason`, exit code."""

    def __init__(self, reason: str, code: int, status: Status = Status.RUNNING) -> None:
        super().__init__(reason)
        self.reason, self.code, self.status = reason, code, status

    @property
    def holds(self) -> bool:
        """Was the run stopped before its end, so that the arms must hold where they are?"""
        return self.code in (Exit.STOPPED, Exit.INTERRUPTED)
