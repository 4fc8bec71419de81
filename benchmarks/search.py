"""How many episodes does the search for achievements need, and how long does it take?"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.encoding.walk import prefix
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Evolve trees by the search for achievements until one solves the task, and try it in unseen layouts."""

    tasks: tuple[str, ...] = ("stack", "stack3", "restack")
    """tasks of the package, or YAML files"""
    seeds: int = 10
    """seeds for each task"""
    first_seed: int = 6000
    """the first of them"""
    population: int = 16
    """trees measured in a generation"""
    episodes: int = 16_000
    """most episodes of a run"""
    level: str = "physics"
    """physics or kinematic"""
    out: Path | None = None
    """JSON file to write"""


@dataclasses.dataclass(frozen=True)
class Solution:
    """What one run took: `episodes` are distinct trees, up to the end of the generation that solved the task."""

    solved: bool
    episodes: int
    seconds: float  # without compiling
    nodes: int
    unseen: float  # share of unseen layouts that the tree solves


def main(arguments: Arguments) -> None:
    configure_jax()
    with CompileClock() as clock:
        rows = [_row(task, list(_solutions(task, arguments, clock))) for task in arguments.tasks]
    seeds = f"seeds {arguments.first_seed} to {arguments.first_seed + arguments.seeds - 1}"
    report("search", f"the method achievements, {arguments.level}, {seeds}", rows, out=arguments.out)


def _solutions(task: str, arguments: Arguments, clock: CompileClock) -> Iterator[Solution]:
    settings = Settings(level=arguments.level)  # type: ignore[arg-type]  # checked by the level's maker
    for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
        config = GPConfig(
            method="achievements",
            population=arguments.population,
            generations=arguments.episodes // arguments.population,
            seed=seed,
        )
        before, began = clock.seconds, perf_counter()
        training = Training(load_task(task), config, settings)
        for state in training.evolution.run():
            if state.knowledge[0].solved:
                break
        seconds = perf_counter() - began - (clock.seconds - before)
        tree = training.best_tree(state)
        unseen = training.test(tree).success_rate
        yield Solution(state.knowledge[0].solved, state.trees_measured[0], seconds, len(prefix(tree)), unseen)


def _row(task: str, found: list[Solution]) -> dict:
    solved = [one for one in found if one.solved]
    return {
        "task": Path(task).stem,
        "solved": f"{len(solved)} of {len(found)}",
        "episodes, median": float(np.median([one.episodes for one in solved])) if solved else None,
        "episodes, most": max((one.episodes for one in solved), default=None),
        "seconds, median": float(np.median([one.seconds for one in found])),
        "seconds, most": max(one.seconds for one in found),
        "nodes": sorted({one.nodes for one in solved}),
        "unseen layouts, least": min((one.unseen for one in solved), default=None),
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments))
