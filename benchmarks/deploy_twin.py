"""How often a tree succeeds on the twin of the robot, left alone and with a person who interferes.

python -m benchmarks.deploy_twin RUN_FOLDER|TREE [--layouts 20] [--first 0] [--factor 1.5] [--no-person] [--jobs 2]
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from rich.console import Console

from benchmarks._report import RESULTS, report
from benchmarks._survey import accumulated, stored
from benchmarks._twin_runs import Job, carry_out, origin

WITH_A_PERSON = 1000  # the first layout of these


@dataclasses.dataclass(frozen=True)
class Arguments:
    source: Annotated[Path, tyro.conf.Positional]
    """run folder or tree"""
    layouts: int = 20
    first: int = 0
    """of the layouts"""
    factor: float = 1.0
    """how many times as far from perfect as a real cell the twin is, see `Realism.scaled`"""
    width: int = 1280
    """of the images, px"""
    person: bool = True
    """run as many other layouts again in which a person interferes"""
    jobs: int = 1
    """runs at a time"""
    out: Path | None = None
    """where the JSON file is, to which runs are added"""


def solved(record: dict[str, Any]) -> bool:
    """Did the robot believe that it was done, and was it?"""
    return record["status"] == "SUCCESS" and record["solved"]


def rows(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table; distances are true ones, of the runs that were solved."""
    surveys: dict[tuple[str, bool, float, int], list[dict[str, Any]]] = {}
    for record in records:
        task = record.get("task", "yumi_stack")  # older records are of this one and do not say it
        surveys.setdefault((task, record["touches"] > 0, record["factor"], record["width"]), []).append(record)
    table = []
    for (task, touched, factor, width), runs in sorted(surveys.items()):
        distances = [distance for run in filter(solved, runs) for distance in run["mm"]]
        table.append(
            {
                "task": task,
                "runs": "with a person" if touched else "alone",
                "factor": factor,
                "width px": width,
                "layouts": len(runs),
                "solved": sum(map(solved, runs)),
                "wrong success": sum(run["status"] == "SUCCESS" and not run["solved"] for run in runs),
                "mm median": float(np.median(distances)) if distances else float("nan"),
                "mm worst": max(distances, default=float("nan")),
                "robot s": float(np.mean([run["robot s"] for run in runs])),
                "wall s": float(np.mean([run["wall s"] for run in runs])),
            }
        )
    return table


def main(arguments: Arguments) -> None:
    console, path = Console(highlight=False, soft_wrap=True), arguments.out or RESULTS / "deploy_twin.json"
    own = origin(arguments.source)
    jobs = [
        Job("", first + layout, touches, arguments.width, arguments.factor, **own)
        for layout in range(arguments.first, arguments.first + arguments.layouts)
        for first, touches in ((0, 0), (WITH_A_PERSON, 1))[: 1 + arguments.person]
    ]
    for record in accumulated(path, jobs, functools.partial(carry_out, arguments.source), arguments.jobs):
        console.print(
            f"layout {record['seed']:4d}  {'✓' if solved(record) else '✗'} {record['robot s']:6.1f} s  "
            f"worst {max(record['mm']):5.1f} mm  {record['reason']}  {record['touched']}",
            markup=False,
        )
    report("deploy_twin", "a tree on the twin", rows(stored(path, code=own["code"])), out=path, runs=stored(path))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
