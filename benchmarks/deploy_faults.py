"""How often trees succeed on the twin of the robot while faults are provoked, each alone: layouts x faults x trees.

python -m benchmarks.deploy_faults RUN_FOLDER|TREE ... [--task yumi_stack] [--faults slip drop hide] [--layouts 10]

A fault is a key of `tasks.faults.FAULTS`, alone as --preset has it, or whatever `--faults` of `deploy twin` takes. All trees
meet the same layouts and draws. Runs that are in the JSON file already are not repeated.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from benchmarks._report import RESULTS, report
from benchmarks._survey import accumulated, code_digest, digest_of, stored
from bt_jax._util.statistics import wilson
from bt_jax.deploy.execution.program import Program, load_program
from bt_jax.deploy.execution.settings import TWIN_SECONDS, Limits
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import run_twin
from bt_jax.tasks import load_faults, with_faults
from bt_jax.tasks.faults import FAULTS, only


@dataclasses.dataclass(frozen=True)
class Arguments:
    trees: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """run folders or trees"""
    task: str | None = None
    """name or YAML file (default: that of each run folder)"""
    faults: tuple[str, ...] = ("slip", "drop", "hide")
    """faults, each alone, or presets and files"""
    preset: str = "harsh"
    """how often a fault happens that is alone"""
    layouts: int = 10
    first: int = 0
    """of the layouts"""
    draw: int = 0
    """of chance in each layout"""
    seconds: float = TWIN_SECONDS
    """time after which a run ends"""
    jobs: int = 1
    """runs at a time"""
    logs: Path | None = None
    """folder for the log of each run"""
    out: Path | None = None
    """where the JSON file is, to which runs are added"""


@dataclasses.dataclass(frozen=True)
class Job:
    """One run. `program`, which includes the task and its faults, and `code` tell runs of other ones apart."""

    tree: str
    fault: str
    layout: int
    draw: int
    seconds: float
    program: str
    code: str


def faulty_program(tree: Path, task: str | None, fault: str, preset: str) -> Program:
    """Return a tree and its task with faults. Raise UserError for faults that are unknown or do not fit the task."""
    program = load_program(tree, task)
    faults = only(load_faults(preset), fault) if fault in FAULTS else load_faults(fault)
    return dataclasses.replace(program, task=with_faults(program.task, faults, source=f"--faults {fault}"))


def carry_out(job: Job, *, task: str | None, preset: str, logs: Path | None = None) -> dict[str, Any]:
    """Return what a run came to, as JSON has it; its log goes into the folder `logs`."""
    name = f"{Path(job.tree).stem}-{Path(job.fault).stem}-{job.layout}-{job.draw}.jsonl"
    run = run_twin(
        YUMI,
        faulty_program(Path(job.tree), task, job.fault, preset),
        job.layout,
        draw=job.draw,
        limits=Limits(run=job.seconds),
        log=None if logs is None else logs / name,
    )
    return {
        "solved": bool(run.solved and run.outcome.status.name == "SUCCESS"),
        "reason": run.outcome.reason,
        "happened": "; ".join(map(str, run.touches)),
        "robot s": round(run.outcome.seconds, 1),
        "wall s": round(run.seconds, 1),
        "rejected": run.counters.rejected,
    }


def rows(records: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the table: a line for each fault and tree."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for record in records:
        groups.setdefault((record["fault"], record["tree"]), []).append(record)
    table = []
    for (fault, tree), runs in sorted(groups.items()):
        count = sum(run["solved"] for run in runs)
        low, high = wilson(count, len(runs))
        provoked = sum(bool(run["happened"]) for run in runs)
        interval = f"{100 * low:.0f} to {100 * high:.0f} %"
        table.append(
            {"fault": fault, "tree": tree, "runs": len(runs), "provoked": provoked, "solved": count, "95 %": interval}
        )
    return table


def main(arguments: Arguments) -> None:
    console, path = Console(highlight=False, soft_wrap=True), arguments.out or RESULTS / "deploy_faults.json"
    code, jobs = code_digest(), []
    for tree in arguments.trees:
        for fault in arguments.faults:
            program = faulty_program(tree, arguments.task, fault, arguments.preset)
            own = f"{program.digest[:12]}-{digest_of(program.task)}"
            jobs += [
                Job(str(tree), fault, layout, arguments.draw, arguments.seconds, own, code)
                for layout in range(arguments.first, arguments.first + arguments.layouts)
            ]
    jobs.sort(key=lambda job: job.layout)  # what is interrupted has a few layouts of all
    work = functools.partial(carry_out, task=arguments.task, preset=arguments.preset, logs=arguments.logs)
    for record in accumulated(path, jobs, work, arguments.jobs):
        console.print(
            f"{Path(record['tree']).name:20s} {record['fault']:8s} {record['layout']:3d}  "
            f"{'✓' if record['solved'] else '✗'} {record['robot s']:6.1f} s  {record['reason']}  [{record['happened']}]",
            markup=False,
        )
    found = rows(stored(path, code=code))
    report("deploy_faults", "trees on the twin while faults are provoked", found, out=path, runs=stored(path))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
