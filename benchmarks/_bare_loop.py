"""A loop that only sleeps, as `cyclictest` does: python _bare_loop.py CORE PRIORITY, until its input ends. Prints the number
of naps, and when [s, monotonic] it woke late, and by how much [s]. What it misses, the machine itself gave no time for."""

from __future__ import annotations

import contextlib
import gc
import json
import os
import select
import sys
import time

NAP = 0.001  # seconds
STALL = 0.0005  # seconds from which on it was late
LOOK = 50  # naps between two looks at the input


def main() -> None:
    core, priority = map(int, sys.argv[1:])
    gc.disable()
    with contextlib.suppress(OSError):
        os.sched_setaffinity(0, {core})
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    print("ready", flush=True)
    stalls: list[tuple[float, float]] = []
    naps, deadline = 0, time.monotonic() + NAP
    while naps % LOOK or not select.select([sys.stdin], [], [], 0)[0]:
        time.sleep(max(0.0, deadline - time.monotonic()))
        now = time.monotonic()
        naps += 1
        if now - deadline > STALL:
            stalls.append((now, now - deadline))
        deadline = max(deadline, now) + NAP
    print(json.dumps({"naps": naps, "stalls": stalls}))


if __name__ == "__main__":
    main()
