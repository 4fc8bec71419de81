"""How many episodes does the search for achievements need, how long does it take, and how good are its trees?"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter, process_time
from typing import Literal

import numpy as np
import tyro

from benchmarks._kits import named
from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.encoding.walk import prefix
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task, load_faults, task_names, with_faults
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

TOWERS = ("tower-of-4", "tower-of-5", "tower-of-6", "tower-of-8")
GUARDED = 5  # nodes of the shortest tree that unstacks: Fallback(reached(unstacked), Sequence(move, move))


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Evolve trees with the defaults of `train`, and try them in unseen layouts."""

    tasks: tuple[str, ...] = (*task_names(), *TOWERS)
    """tasks of the package, YAML files, tower-of-N or kit-of-N"""
    seeds: int = 10
    """seeds for each task"""
    first_seed: int = 8000
    """the first of them"""
    population: int = 16
    """trees measured in a generation"""
    episodes: int = 16_000
    """most episodes of a run"""
    level: Literal["physics", "kinematic"] = "physics"
    """physics or kinematic"""
    faults: str | None = None
    """what goes wrong: mild, harsh or a YAML file; nothing if it is not given"""
    out: Path | None = None
    """JSON file to write"""


@dataclasses.dataclass(frozen=True)
class Run:
    """What one run took. `episodes` are distinct trees, up to the end of the generation that solved the task; all else is
    that of the whole run, which goes on until nothing improves."""

    seed: int
    solved: bool
    episodes: int
    seconds: float  # without compiling
    processor_seconds: float  # of all threads; compiling counts
    fitness: float
    nodes: int
    unseen: float  # percent of the episodes in unseen layouts


def main(arguments: Arguments) -> None:
    configure_jax()
    rows = []
    with CompileClock() as clock:
        for name in arguments.tasks:
            task = named(name)
            if arguments.faults is not None:
                task = with_faults(task, load_faults(arguments.faults))
            rows.append(_row(task, list(_runs(task, arguments, clock))))
            print(rows[-1], flush=True)
    seeds = f"seeds {arguments.first_seed} to {arguments.first_seed + arguments.seeds - 1}"
    faults = "" if arguments.faults is None else f", faults {arguments.faults}"
    report(
        "search", f"the method achievements, {arguments.level}, {seeds}{faults}", rows, out=arguments.out, seeds=seeds
    )


def _runs(task: Task, arguments: Arguments, clock: CompileClock) -> Iterator[Run]:
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        config = GPConfig(population=arguments.population, seed=seed)
        before, began, used = clock.seconds, perf_counter(), process_time()
        training = Training(task, config, Settings(level=arguments.level))
        solved_after = None
        for state in training.evolution.run():
            if solved_after is None and state.knowledge[0].solved:
                solved_after = state.trees_measured[0]
            if solved_after is None and state.trees_measured[0] >= arguments.episodes:
                break
        seconds = perf_counter() - began - (clock.seconds - before)
        used = process_time() - used
        tree = training.best_tree(state)
        run = Run(
            seed,
            solved_after is not None,
            state.trees_measured[0] if solved_after is None else solved_after,
            seconds,
            used,
            float(np.max(state.population.fitness)),
            len(prefix(tree)),
            round(100 * training.test(tree).success_rate, 1),
        )
        print(f"{task.name}: {run}", file=sys.stderr, flush=True)
        yield run


def _row(task: Task, runs: list[Run]) -> dict:
    solved = [run for run in runs if run.solved]
    least = len(task.targets) + 1 + GUARDED * len(task.subgoals)
    return {
        "task": task.name,
        "solved": f"{len(solved)} of {len(runs)}",
        "episodes, median": float(np.median([run.episodes for run in solved])) if solved else None,
        "episodes, most": max((run.episodes for run in solved), default=None),
        "seconds, median": round(float(np.median([run.seconds for run in runs])), 2),
        "seconds, most": round(max(run.seconds for run in runs), 2),
        "processor seconds, median": round(float(np.median([run.processor_seconds for run in runs])), 2),
        "processor seconds, most": round(max(run.processor_seconds for run in runs), 2),
        "nodes, least possible": least,
        "nodes, most": max((run.nodes for run in solved), default=None),
        "unseen episodes solved, least percent": min((run.unseen for run in solved), default=None),
        "fitness, median": round(float(np.median([run.fitness for run in runs])), 1),
        "fitness, worst": round(min(run.fitness for run in runs), 1),
        "seeds not solved": [run.seed for run in runs if not run.solved],
        "seeds with superfluous nodes": [run.seed for run in solved if run.nodes > least],
        "seeds that fail in a layout": [run.seed for run in solved if run.unseen < 100],
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments))
