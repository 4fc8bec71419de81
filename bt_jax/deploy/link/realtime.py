"""What lets a Python process keep a 4 ms cycle beside others: priority, no garbage collection, and shared memory that is
read without ever waiting for the writer."""

from __future__ import annotations

import contextlib
import gc
import multiprocessing
import os
import signal
import sys
import time

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError

__all__ = ["CONTEXT", "FIFO_PRIORITY", "Snapshot", "may_take_priority", "sleep_until", "take_priority"]

CONTEXT = multiprocessing.get_context("spawn")  # a forked process would inherit locks that threads of ours hold
FIFO_PRIORITY = 20
SWITCH_INTERVAL = 0.0005  # seconds after which a helper thread gives the interpreter back
SPIN = 0.0002  # seconds before a deadline in which sleeping is not exact enough


def take_priority(*, realtime: bool) -> bool:
    """Leave signals to the program, also SIGTERM to its process group, to the parent, which ends this process in order, and
    in real time make it one that is served first.

    Return False where the system does not permit that (then niceness is tried)."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(os, "setpgrp"):
        os.setpgrp()
    if not realtime:
        return False
    sys.setswitchinterval(SWITCH_INTERVAL)
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(FIFO_PRIORITY))
    except (OSError, AttributeError):
        with contextlib.suppress(OSError):
            os.nice(-10)
        return False
    return True


def may_take_priority() -> bool:
    """May this user's processes ask for real-time priority? Nothing is changed."""
    try:
        policy, priority = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, policy, priority)
    except (OSError, AttributeError):
        return False
    return True


def sleep_until(deadline: float) -> float:
    """Sleep until `time.monotonic()` is `deadline`; return by how many seconds that was missed (0 or more)."""
    while (left := deadline - time.monotonic()) > 0:
        time.sleep(max(left - SPIN, 0) if left > SPIN else 0)
    return -left


class Snapshot:
    """An array of float64 in shared memory with one writer and any number of readers.

    The writer makes the version odd while it writes; a reader that sees an odd or a changed version reads again. If an odd
    version stays the same for `patience` seconds, the writer is dead.
    """

    def __init__(self, size: int, *, patience: float = 2.0) -> None:
        self._memory, self._patience = CONTEXT.RawArray("d", size + 1), patience

    def _view(self) -> Float[np.ndarray, " version_and_size"]:
        return np.frombuffer(self._memory)

    def write(self, values: Float[np.ndarray, " size"]) -> None:
        """Replace the values."""
        view = self._view()
        view[0] += 1
        view[1:] = values
        view[0] += 1

    def read(self) -> Float[np.ndarray, " size"]:
        """Return a consistent copy. Raise UserError if the writer does not end what it began to write."""
        view, seen, deadline = self._view(), -1.0, 0.0
        while True:
            version = view[0]
            values = view[1:].copy()
            if version % 2 == 0 and version == view[0]:
                return values
            now = time.monotonic()
            if version != seen:  # a reader that is starved sees a live writer change it
                seen, deadline = version, now + self._patience
            if now > deadline:
                raise UserError("a process of the robot's link ended while it told its state; start the run again")
            time.sleep(0)
