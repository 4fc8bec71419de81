"""Why a loop comes late: for each time that it does, what the process did and suffered since the time before."""

from __future__ import annotations

import dataclasses
import resource
import time
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.realtime import CONTEXT

__all__ = ["LateRound", "LoopTimer"]

KEPT = 1024  # late rounds; older ones are overwritten
NEAR = 0.001  # seconds from which on a round is kept


@dataclasses.dataclass(frozen=True)
class LateRound:
    """One round of a loop that began late."""

    time: float  # when it began, monotonic [s]
    late: float  # by how much [s]
    slack: float  # seconds that were left for sleep; negative: the work before took too long
    faults: int  # memory pages that were not there
    forced: int  # times that the kernel gave the processor to another
    parts: Mapping[str, float]  # seconds that each part of the work before took


class LoopTimer:
    """Shared memory with one writer, the loop that is watched; whoever made it reads. `parts` name the parts of its work."""

    def __init__(self, parts: tuple[str, ...]) -> None:
        self.parts = parts
        self._width = 5 + len(parts)
        self._rows = CONTEXT.RawArray("d", KEPT * self._width)
        self._written = CONTEXT.RawValue("L", 0)
        self._took = dict.fromkeys(parts, 0.0)
        self._last = self._slack = 0.0
        self._usage = (0, 0)

    def begin(self, late: float) -> None:
        """Note that a round begins, so many seconds late."""
        now = time.monotonic()
        used = resource.getrusage(resource.RUSAGE_THREAD)
        usage = (used.ru_minflt + used.ru_majflt, used.ru_nivcsw)
        if late > NEAR:
            suffered = [new - old for new, old in zip(usage, self._usage, strict=True)]
            self._view()[self._written.value % KEPT] = [now, late, self._slack, *suffered, *self._took.values()]
            self._written.value += 1
        self._usage, self._last = usage, now
        self._took = dict.fromkeys(self.parts, 0.0)

    def done(self, part: str) -> None:
        """Note that a part of the work is done."""
        now = time.monotonic()
        self._took[part] += now - self._last
        self._last = now

    def end(self, deadline: float) -> None:
        """Note that all work is done; the next round begins at `deadline`, `time.monotonic()`."""
        self._slack = deadline - time.monotonic()

    def read(self) -> list[LateRound]:
        """Return what was kept, oldest first. The last one may be half written while the loop runs."""
        written = self._written.value
        rows = self._view()[np.arange(max(0, written - KEPT), written) % KEPT].tolist()
        return [
            LateRound(now, late, slack, int(faults), int(forced), dict(zip(self.parts, took, strict=True)))
            for now, late, slack, faults, forced, *took in rows
        ]

    def _view(self) -> Float[np.ndarray, "rows columns"]:
        return np.frombuffer(self._rows).reshape(KEPT, self._width)
