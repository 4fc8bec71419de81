"""Processor time of processes, which other load on the machine does not change much, as seconds on the clock do."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["processor_seconds"]

TICKS = os.sysconf("SC_CLK_TCK")


def processor_seconds(root: int, *, below: bool = False) -> float:
    """Seconds that a process has computed, with all `below` it if asked. Linux only."""
    parents, seconds = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            continue  # it has ended
        pid = int(stat.parent.name)
        parents[pid], seconds[pid] = int(fields[1]), (int(fields[11]) + int(fields[12])) / TICKS

    def is_below(pid: int) -> bool:
        while pid in parents and pid != root:
            pid = parents[pid]
        return pid == root

    return sum(spent for pid, spent in seconds.items() if pid == root or (below and is_below(pid)))
