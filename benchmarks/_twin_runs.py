"""Runs of a tree on the twin, several at a time, kept in a file as they end: a survey that was interrupted goes on."""

from __future__ import annotations

import concurrent.futures
import dataclasses
import json
import multiprocessing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism


@dataclasses.dataclass(frozen=True)
class Job:
    """One run: `disturbance` as `run_twin` knows it, "" for none; `touches` of a person; images `width` px wide."""

    disturbance: str
    seed: int
    touches: int = 0
    width: int = 1280
    factor: float = 1.0  # of all that `Realism` says
    limit: float = 240.0  # s


def carry_out(source: Path, job: Job, logs: Path | None = None) -> dict[str, Any]:
    """Return what a run came to, as JSON has it; its log goes into the folder `logs`. `after`: seconds from the last touch,
    or from the start, to the end."""
    realism = dataclasses.replace(Realism().scaled(job.factor), width=job.width, height=job.width * 3 // 4)
    run = run_twin(
        YUMI,
        load_program(source),
        job.seed,
        realism=realism,
        disturbances=job.touches,
        disturbance=job.disturbance or None,
        limits=Limits(run=job.limit),
        log=None if logs is None else logs / f"{job.disturbance or 'twin'}-{job.touches}-{job.seed}.jsonl",
    )
    last = max((touch.time for touch in run.touches), default=run.start)
    return {
        **dataclasses.asdict(job),
        "status": run.outcome.status.name,
        "reason": run.outcome.reason,
        "solved": bool(run.solved),
        "touched": "; ".join(map(str, run.touches)),
        "robot s": round(run.outcome.seconds, 1),
        "after": round(run.start + run.outcome.seconds - last, 1),
        "wall s": round(run.seconds, 1),
        "mm": [round(1000 * float(distance), 2) for distance in run.distances],
        "cycles": run.stats.cycles,
        "missed": run.stats.missed,
        "ticks": run.outcome.ticks,
        "slow ticks": run.outcome.overruns,
    }


def stored(path: Path) -> list[dict[str, Any]]:
    """Return the records in a file, none if it is missing."""
    return json.loads(path.read_text(encoding="utf-8")).get("runs", []) if path.exists() else []


def accumulated(
    path: Path, source: Path, jobs: Sequence[Job], processes: int, logs: Path | None = None
) -> Iterator[dict[str, Any]]:
    """Yield the record of each job: those in the file first, then new ones as they end and are added to it."""
    records = stored(path)
    done = {tuple(record[field.name] for field in dataclasses.fields(Job)): record for record in records}
    missing = [job for job in jobs if dataclasses.astuple(job) not in done]
    yield from (done[dataclasses.astuple(job)] for job in jobs if dataclasses.astuple(job) in done)
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(processes, mp_context=context) as pool:
        futures = [pool.submit(carry_out, source, job, logs) for job in missing]
        for future in concurrent.futures.as_completed(futures):
            records.append(future.result())
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(json.dumps({"runs": records}, indent=1) + "\n", encoding="utf-8")
            yield records[-1]
