"""Is MJX on an accelerator worth it? Compile time and throughput of both implementations, beside the C engine.

python -m benchmarks.gpu

Nothing here has been tried on a GPU yet: none was at hand. The aim for one H200 is 1,000,000 episodes a second without
chance, and 50,000 with chance, where every transition is new. The script needs a checkout and the package with its extra
`cuda`. For a machine that cannot download, fetch the wheels on one of the same kind that can, and carry the folder over:

    python -m pip download -d wheels ".[cuda]" setuptools             # here; about 3 GB
    python -m pip install --no-index --find-links wheels ".[cuda]"    # there; it needs a driver for CUDA 13

Every part runs in a process of its own with a share of the time, so that one that fails, hangs or is skipped costs only its
own rows. Without an accelerator the same is measured on the CPU; `--small` does so in a minute
of computing.
"""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

import tyro
from rich.console import Console

from benchmarks._report import report, show

GRACE = 5.0  # seconds between the time at which a part should end by itself and its end


@dataclasses.dataclass(frozen=True)
class Arguments:
    """MJX on an accelerator: compile time, throughput, parity with the C engine, and a profile. Not tried on a GPU yet."""

    task: str = "stack3"
    """task whose gene pool and layouts are used"""
    sizes: tuple[int, ...] = (256, 1024, 4096, 16384, 65536)
    """numbers of episodes that run together"""
    trees: int = 1000
    """random trees that MJX and the C engine have to agree on"""
    minutes: float = 8.0
    """time for everything; what does not fit is skipped"""
    small: bool = False
    """few episodes and trees, to see that the script works"""
    out: Path | None = None
    """JSON file to write"""


@dataclasses.dataclass(frozen=True)
class Part:
    """A process: what it measures, with which implementation of MJX, and its share of the time. Parts that end early
    leave the rest of theirs to the later ones."""

    name: str
    implementation: str
    weight: float
    on_cpu: bool = False

    @property
    def title(self) -> str:
        return f"{self.name} {self.implementation}".strip()


PARTS = (
    Part("device", "", 10),
    Part("trees", "", 10, on_cpu=True),
    Part("engine", "C", 10, on_cpu=True),
    Part("table", "jax", 25),
    Part("rollout", "jax", 25),
    Part("table", "warp", 15),
    Part("rollout", "warp", 15),
    Part("profile", "jax", 8),
)


def main(arguments: Arguments) -> None:
    if arguments.small:
        arguments = dataclasses.replace(arguments, sizes=(16,), trees=16)
    began = perf_counter()
    rows: dict[str, list[dict[str, Any]]] = {}
    failed: dict[str, str] = {}
    console = Console()
    with tempfile.TemporaryDirectory() as scratch:
        for i, part in enumerate(PARTS):
            left = 60 * arguments.minutes - (perf_counter() - began) - GRACE
            share = left * part.weight / sum(later.weight for later in PARTS[i:])
            found, reason = run_part(part, arguments, Path(scratch), share)
            for row in found:
                rows.setdefault(row.pop("kind"), []).append(row)
            if reason:
                failed[part.title] = reason
            told = reason or f"done, {perf_counter() - began:.0f} s since the start"
            console.print(f"{part.title}: {told}", markup=False, highlight=False, soft_wrap=True)
    for kind in ("device", "settling", "parity", "profile"):
        if kind in rows:
            show(kind, rows[kind])
    speed = rows.get("speed", [])
    report(
        "gpu",
        f"{arguments.task}: random trees and layouts; tables from empty and full, rollouts without and with chance",
        speed or [{"nothing could be measured": ", ".join(failed)}],
        out=arguments.out,
        where=rows.get("device", [{}])[0],
        settling=rows.get("settling", []),
        parity=rows.get("parity", []),
        profile=rows.get("profile", []),
        failed=failed,
        seconds=perf_counter() - began,
    )


def run_part(part: Part, arguments: Arguments, scratch: Path, seconds: float) -> tuple[list[dict[str, Any]], str]:
    """Rows that a part has printed, and why there are not more of them, if so."""
    if seconds <= 0:
        return [], "no time was left"
    request = {
        "part": part.name,
        "implementation": part.implementation,
        "task": arguments.task,
        "sizes": arguments.sizes,
        "trees": arguments.trees,
        "seconds": seconds,
        "scratch": str(scratch),
    }
    environment = os.environ | ({"JAX_PLATFORMS": "cpu"} if part.on_cpu else {})
    log = scratch / f"{part.title}.log"
    with log.open("w+", encoding="utf-8") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchmarks._gpu_part", json.dumps(request)],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
        )
        try:
            output, reason = process.communicate(timeout=seconds + GRACE)[0], ""
        except subprocess.TimeoutExpired:
            process.kill()
            output, reason = process.communicate()[0], f"stopped, it did not end within {seconds:.0f} s"
    rows = [json.loads(line) for line in output.splitlines() if line.startswith("{")]
    if not reason and process.returncode:
        lines = log.read_text(encoding="utf-8").strip().splitlines()
        reason = f"failed with exit code {process.returncode}: {lines[-1] if lines else 'without a word'}"
    skipped = [row["skipped"] for row in rows if "skipped" in row]
    return [row for row in rows if "skipped" not in row], "; ".join([*skipped, *([reason] if reason else [])])


if __name__ == "__main__":
    main(tyro.cli(Arguments, description=__doc__))
