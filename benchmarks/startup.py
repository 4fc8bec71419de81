"""How long commands take to answer: `--help`, the result of a small evolution, the first tick of a run.

    python -m benchmarks.startup

`shown` is when the line that the user waits for appears on stdout, `ended` when the process has ended, `cpu` its user and
system time; all in seconds, medians. `floors` is `shown` against importing JAX and MuJoCo and nothing else, measured in
the same run, so that machines and busy hours can be compared. Cold: nothing was compiled before; new shape: stack was, and
no task with that number of boxes; there, `shown` is the first generation.
"""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import tyro

from benchmarks._report import report

HELP = [
    *("train", "learn", "run", "demonstrate", "app", "experiments", "deploy"),
    *(f"deploy {name}" for name in ("twin", "check", "run", "markers", "calibrate", "rapid", "replay")),
]
FLOOR = "import jax, mujoco"
SCRIPT = "pick GreenBox; to (0, 0, 0.1) YellowBox; release"


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Measure how long commands take to answer."""

    repeat: int = 5
    """processes of each kind; the table shows medians"""
    cold_repeat: int = 3
    """the same for those that compile everything"""
    boxes: tuple[int, ...] = (4, 5, 6)
    """numbers of boxes of the tasks of a new shape"""
    out: Path | None = None
    """file for the results (default: benchmarks/results/startup.json)"""


@dataclasses.dataclass(frozen=True)
class Timing:
    """One process, in seconds: from its start until the line was shown and until its end, and its CPU time."""

    shown: float
    ended: float
    cpu: float


def main(arguments: Arguments) -> None:
    """Measure everything, print the table and write it."""
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        rows = measure(Path(folder), arguments)
    report(
        "startup", "start-up of commands", rows, out=arguments.out, load_at_start=load, load_at_end=os.getloadavg()[0]
    )


def measure(folder: Path, arguments: Arguments) -> list[dict[str, Any]]:
    """Measure each kind of process; `folder` takes what they write."""
    warm, run, shown = folder / "warm", folder / "run", folder / "demonstrations"
    module = [sys.executable, "-m"]
    train = [*module, "bt_jax.train"]
    timed([*train, "stack", "--out", str(run)], "fitness", warm)  # compiles, and leaves a folder to run
    timed([*module, "bt_jax.demonstrate", str(shown), SCRIPT], "learn from", warm)
    floor = [timed([sys.executable, "-c", FLOOR], "", warm) for _ in range(arguments.repeat)]
    kinds: list[tuple[str, list[str], str]] = [
        *((f"{name} --help", [*module, *f"bt_jax.{name} --help".split()], "usage") for name in HELP),
        ("train stack", [*train, "stack", "--out", "OUT"], "fitness"),
        ("run FOLDER", [*module, "bt_jax.run", str(run)], "tick"),
        ("learn FOLDER", [*module, "bt_jax.learn", str(shown), "--out", "OUT"], "tried"),
    ]
    rows = [_row(FLOOR, floor, floor)]
    for name, command, marker in kinds:
        timed(_fresh(command, folder), marker, warm)  # compiles
        rows.append(_row(name, [timed(_fresh(command, folder), marker, warm) for _ in range(arguments.repeat)], floor))
    few = ["--generations", "2"]
    cold = [("train stack, cold", ["stack"], "fitness")]
    for count in arguments.boxes:
        cold.append(
            (f"train with {count} boxes, new shape", ["--task", str(task_of(count, folder)), *few], "generation")
        )
    for name, words, marker in cold:
        timings = []
        for _ in range(arguments.cold_repeat):
            with tempfile.TemporaryDirectory() as cache:
                if "new shape" in name:
                    shutil.copytree(warm, cache, dirs_exist_ok=True)
                timings.append(timed(_fresh([*train, *words, "--out", "OUT"], folder), marker, Path(cache)))
        rows.append(_row(name, timings, floor))
    return rows


def task_of(count: int, folder: Path) -> Path:
    """Write a task with so many boxes, those of the published scene and more, and return its file."""
    names = ("YellowBox", "GreenBox", "BlueBox", *(f"Box{i}" for i in range(4, count + 1)))
    boxes = [{"name": name, "size": 0.1, "color": [0.5, 0.5, 0.5]} for name in names]
    path = folder / f"boxes{count}.yaml"
    path.write_text(json.dumps({"name": f"boxes{count}", "extends": "stack3", "boxes": boxes}), encoding="utf-8")
    return path


def timed(command: Sequence[str], marker: str, cache: Path) -> Timing:
    """Run a command; `marker` begins the line that is waited for. Raises RuntimeError if it does not come."""
    environment = {**os.environ, "BT_JAX_CACHE": str(cache)}
    began, shown = perf_counter(), None
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
    assert process.stdout is not None
    for line in process.stdout:
        if shown is None and line.startswith(marker):
            shown = perf_counter() - began
    _, status, usage = os.wait4(process.pid, 0)
    ended = perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode or (shown is None and marker):
        raise RuntimeError(f"{' '.join(command)} ended with code {process.returncode} and showed no '{marker}'")
    return Timing(shown or ended, ended, usage.ru_utime + usage.ru_stime)


def _fresh(command: Sequence[str], folder: Path) -> list[str]:
    """The command with a new folder for its results."""
    return [tempfile.mkdtemp(dir=folder) if word == "OUT" else word for word in command]


def _row(name: str, timings: Sequence[Timing], floor: Sequence[Timing]) -> dict[str, Any]:
    shown = median(timing.shown for timing in timings)
    return {
        "process": name,
        "shown": round(shown, 3),
        "ended": round(median(timing.ended for timing in timings), 3),
        "cpu": round(median(timing.cpu for timing in timings), 3),
        "floors": round(shown / median(timing.ended for timing in floor), 2),
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments))
