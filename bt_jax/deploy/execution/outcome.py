"""What the caller of a run gives and gets: limits, each tick as it is shown, and how the run ended."""

from __future__ import annotations

import dataclasses

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.observation import Observation
from bt_jax.encoding.status import Status

__all__ = ["Exit", "Halt", "Limits", "Outcome", "Shown"]


class Exit:
    """What the process tells its caller."""

    DONE, FAILED, USER_ERROR, STOPPED, INTERRUPTED = 0, 1, 2, 3, 130


@dataclasses.dataclass(frozen=True)
class Limits:
    """Seconds."""

    tick: float = 0.1  # from tick to tick
    run: float = 600.0  # the whole run
    action: float = 60.0  # one attempt, at the twin's speed
    look: float = 3.0  # for what is not seen to be seen once the arms are out of the way; then it counts as absent
    settle: float = 0.5  # for the camera to see what an attempt has changed
    patience: float = 10.0  # for which the tree may fail before the run has failed
    success: float = 1.0  # for which it must succeed
    image: float = 1.0  # the newest image may be old


@dataclasses.dataclass(frozen=True)
class Outcome:
    """How a run ended; `status` is RUNNING where it was stopped."""

    status: Status
    reason: str
    exit_code: int
    seconds: float
    ticks: int
    overruns: int  # ticks that took longer than they may


@dataclasses.dataclass(frozen=True)
class Shown:
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
        """Was the run stopped in the midst of it, so that the arms must hold where they are?"""
        return self.code in (Exit.STOPPED, Exit.INTERRUPTED)
