"""How long does an evolution take? Cold and warm processes, solving times by population, and large populations."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

PAPER_SECONDS = 15 * 60  # of 50 generations (paper, section IV)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Wall times of evolutions of experiment 1a at the physics level."""

    populations: tuple[int, ...] = (16, 64, 256, 1024, 4096)
    """populations to solve the task with"""
    target: float = -35.0
    """fitness at which it counts as solved"""
    large: int = 10_000
    """population for the throughput test, 10 generations"""
    seeds: int = 3
    """seeds for each population"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    processes = _processes()
    configure_jax()
    with CompileClock() as clock:
        solving = [_solve(population, arguments, clock) for population in arguments.populations]
        throughput = _throughput(arguments.large, clock)
    report("evolution_processes", "python -m bt_jax.train stack --method population", processes)
    report("evolution_large", "10 generations, from an empty table", throughput)
    report("evolution", f"time to fitness {arguments.target:g}", solving, out=arguments.out)


def _processes() -> list[dict]:
    """Whole processes, with an empty and a filled compilation cache."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        environment = os.environ | {"BT_JAX_CACHE": f"{folder}/cache"}
        for name in ("cold", "warm", "warm again"):
            out = Path(folder) / name.replace(" ", "-")
            began = perf_counter()
            subprocess.run(
                [sys.executable, "-m", "bt_jax.train", "stack", "--method", "population", "--out", str(out)],
                env=environment,
                check=True,
                stdout=subprocess.DEVNULL,
            )
            seconds = perf_counter() - began
            result = json.loads((out / "result.json").read_text())
            session = result["last_session"]
            rows.append(
                {
                    "process": name,
                    "whole process [s]": seconds,
                    "evolution [s]": session["seconds"] - session["compile_seconds"],
                    "compiling [s]": session["compile_seconds"],
                    "ratio to the paper's 15 min": PAPER_SECONDS / seconds,
                    "fitness": result["fitness"],
                }
            )
    return rows


def _solve(population: int, arguments: Arguments, clock: CompileClock) -> dict:
    """Time until the target is reached (at most 200 generations), over some seeds; compile time apart."""
    seconds, generations, episodes, solved, compiling = [], [], [], 0, 0.0
    for seed in range(arguments.seeds):
        before = clock.seconds
        began = perf_counter()
        training = Training(
            load_task("stack"),
            GPConfig(method="population", population=population, generations=200, seed=seed),
            Settings(),
        )
        *_, state = training.evolution.run(target=arguments.target)
        spent = clock.seconds - before
        compiling += spent
        seconds.append(perf_counter() - began - spent)
        generations.append(state.generation)
        episodes.append(state.trees_measured[0])
        solved += float(state.population.fitness.max()) >= arguments.target
    return {
        "population": population,
        "solved": f"{solved} of {arguments.seeds}",
        "seconds, mean": float(np.mean(seconds)),
        "seconds, std": float(np.std(seconds)),
        "generations, mean": float(np.mean(generations)),
        "episodes, mean": float(np.mean(episodes)),
        "compiling [s]": compiling,
    }


def _throughput(population: int, clock: CompileClock) -> list[dict]:
    """Episodes/s of a large population with an empty transition table; the first run compiles."""
    rows = []
    for name in ("compiles", "compiled"):
        before, began = clock.seconds, perf_counter()
        training = Training(
            load_task("stack"), GPConfig(method="population", population=population, generations=10), Settings()
        )
        *_, state = training.evolution.run()
        spent, whole = clock.seconds - before, perf_counter() - began
        table = training.table
        measured = population + 10 * training.config.num_offspring
        rows.append(
            {
                "run": name,
                "population": population,
                "episodes": measured,
                "of distinct trees": state.trees_measured[0],
                "seconds": whole - spent,
                "compiling [s]": spent,
                "episodes/s": measured / (whole - spent),
                "transitions": table.num_transitions,
                "simulated": table.settler.solved,
                "physics steps": table.settler.steps,
            }
        )
    return rows


if __name__ == "__main__":
    main(tyro.cli(Arguments))
