"""How often a tree succeeds on the twin of the robot, left alone and with a person who interferes.

python -m benchmarks.deploy_twin RUN_FOLDER|TREE [--layouts 20] [--realtime]
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from rich.console import Console

from benchmarks._report import report
from bt_jax.deploy.commands.arguments import DEFAULT_TASK
from bt_jax.deploy.commands.twin import survey
from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.twin.run import TwinRun


@dataclasses.dataclass(frozen=True)
class Arguments:
    source: Annotated[Path, tyro.conf.Positional]
    """run folder or tree"""
    layouts: int = 20
    realtime: bool = False
    """keep 250 Hz by the clock"""
    out: Path | None = None
    """where to write the JSON file"""


def row(title: str, runs: list[TwinRun]) -> dict:
    """One line of the table; distances are true ones, of the runs that were solved."""
    good = [run for run in runs if run.exit_code == Exit.DONE]
    distances = [1000 * distance for run in good for distance in run.distances]
    return {
        "runs": title,
        "layouts": len(runs),
        "solved": len(good),
        "touches": sum(len(run.touches) for run in runs),
        "mm median": float(np.median(distances)) if distances else float("nan"),
        "mm worst": max(distances, default=float("nan")),
        "robot s": float(np.mean([run.outcome.seconds for run in runs])),
        "wall s": float(np.mean([run.seconds for run in runs])),
        "cycles": sum(run.stats.cycles for run in runs),
        "missed": sum(run.stats.missed for run in runs),
        "ticks": sum(run.outcome.ticks for run in runs),
        "slow ticks": sum(run.outcome.overruns for run in runs),
    }


def main(arguments: Arguments) -> None:
    program, console = load_program(arguments.source, otherwise=DEFAULT_TASK), Console(highlight=False)
    rows = []
    for title, first, disturbances in (("alone", 0, 0), ("with a person", 1000, 1)):
        seeds = range(first, first + arguments.layouts)
        runs = survey(program, seeds, disturbances=disturbances, realtime=arguments.realtime, console=console)
        rows.append(row(title, runs))
    report("deploy_twin", "a tree on the twin", rows, out=arguments.out, realtime=str(arguments.realtime))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
