"""Runs of a tree on the twin, for surveys that go on where they were interrupted."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from benchmarks._survey import code_digest, digest_of
from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.execution.settings import Limits
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.run import run_twin
from bt_jax.deploy.twin.settings import Realism


@dataclasses.dataclass(frozen=True)
class Job:
    """One run: `disturbance` as `run_twin` knows it, "" for none; `touches` of a person; images `width` px wide. `program`
    and `code` tell runs of other trees, tasks and versions of the package apart."""

    disturbance: str
    seed: int
    touches: int = 0
    width: int = 1280
    factor: float = 1.0  # of all that `Realism` says
    limit: float = 240.0  # s
    program: str = ""
    code: str = ""


def origin(source: Path) -> dict[str, str]:
    """Return the `program` and the `code` of jobs that run the tree of a run folder or file now."""
    program = load_program(source)
    return {"program": f"{program.digest[:12]}-{digest_of(program.task)}", "code": code_digest()}


def carry_out(source: Path, job: Job, logs: Path | None = None) -> dict[str, Any]:
    """Return what a run came to, as JSON has it; its log goes into the folder `logs`. `after`: seconds from the last touch,
    or from the start, to the end."""
    program = load_program(source)
    realism = dataclasses.replace(Realism().scaled(job.factor), width=job.width, height=job.width * 3 // 4)
    run = run_twin(
        YUMI,
        program,
        job.seed,
        realism=realism,
        disturbances=job.touches,
        disturbance=job.disturbance or None,
        limits=Limits(run=job.limit),
        log=None if logs is None else logs / f"{job.disturbance or 'twin'}-{job.touches}-{job.seed}.jsonl",
    )
    last = max((touch.time for touch in run.touches), default=run.start)
    return {
        "task": program.task.name,
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
