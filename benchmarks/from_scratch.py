"""Experiment 3 by evolution alone, without a demonstration: which population solves it in every run, and how fast?"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.evolution import best_of
from bt_jax.tasks import Task, load_task
from bt_jax.tasks.task import SubgoalReward
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

# Niches are by size, hence few nodes; long chains of mutations cross the valleys between the steps of a solution.
SEARCH = GPConfig(
    method="population",
    niches=True,
    survivor_selection=Selection.ELITISM,
    max_nodes=12,
    max_mutations=6,
    chain_ratio=1.0,
    p_add=0.3,
    p_delete=0.3,
    p_change=0.4,
)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Solving times of `restack` by population, with niches; beside it without, and with the other rule for subgoals."""

    populations: tuple[int, ...] = (256, 512, 1024, 2048)
    """populations to try"""
    rules: tuple[SubgoalReward, ...] = ("ticked", "seen")
    """when the subgoal counts as reached: the published rule with all populations, any other with the last but one"""
    runs: int = 10
    """runs of each, one after the other, with seeds of their own"""
    seed: int = 1000
    """seed of the first run; the settings were found with the seeds 0 to 9 and the rule `seen`"""
    generations: int = 400
    """generations after which a run has failed"""
    time_limit: float = 60.0
    """seconds after which a run has failed"""
    solved: float = -95.0
    """fitness at which the task counts as solved"""
    without_niches: int = 1024
    """population of the row without niches; 0 leaves it out"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    with CompileClock() as clock:
        rows, trees = [], {}
        for rule in arguments.rules:
            task = dataclasses.replace(load_task("restack"), subgoal_reward=rule)
            populations = arguments.populations if rule == arguments.rules[0] else arguments.populations[-2:-1]
            searches = [(population, SEARCH) for population in populations]
            if arguments.without_niches:
                searches.append((arguments.without_niches, dataclasses.replace(SEARCH, niches=False)))
            for population, search in searches:
                config = dataclasses.replace(search, population=population, generations=arguments.generations)
                row, found = _solve(task, config, arguments, clock)
                rows.append(row)
                trees[f"{rule}, {population}, {'niches' if search.niches else 'no niches'}"] = found
    report(
        "from_scratch",
        f"restack from scratch, to fitness {arguments.solved:g}",
        rows,
        out=arguments.out,
        trees=trees,
        settings={name: value for name, value in dataclasses.asdict(SEARCH).items() if name != "population"},
    )


def _solve(task: Task, config: GPConfig, arguments: Arguments, clock: CompileClock) -> tuple[dict, list[dict]]:
    """All runs of one population; times are of the evolution alone, from an empty transition table."""
    before, solved, found = clock.seconds, [], []
    _warm_up(task, config)
    for seed in range(arguments.seed, arguments.seed + arguments.runs):
        spent, began = clock.seconds, perf_counter()
        training = Training(task, dataclasses.replace(config, seed=seed), Settings())
        *_, state = training.evolution.run(target=arguments.solved, time_limit=arguments.time_limit)
        seconds = perf_counter() - began - (clock.seconds - spent)
        tree, fitness = training.best_tree(state), float(best_of(state)[1][0])
        unseen = int(training.test(tree).solved.sum())
        row = {
            "seed": seed,
            "fitness": fitness,
            "generations": state.generation,
            "episodes": state.trees_measured[0],
            "seconds": seconds,
            "unseen layouts solved of 100": unseen,
            "tree": one_line(tree),
        }
        print(
            f"{task.subgoal_reward}, population {config.population}, seed {seed}: {fitness:.1f}, {state.generation} "
            f"generations, {seconds:.1f} s",
            flush=True,
        )
        found.append(row)
        if fitness >= arguments.solved:
            solved.append(row)

    def over(name: str, function) -> float:
        return float(function([row[name] for row in solved])) if solved else float("nan")

    return {
        "subgoal": task.subgoal_reward,
        "population": config.population,
        "niches": "yes" if config.niches else "no",
        "solved": f"{len(solved)} of {arguments.runs}",
        "generations, mean": over("generations", np.mean),
        "most": over("generations", np.max),
        "episodes, mean": over("episodes", np.mean),
        "seconds, mean": over("seconds", np.mean),
        "seconds, most": over("seconds", np.max),
        "unseen layouts solved of 100, worst": over("unseen layouts solved of 100", np.min),
        "seconds of all runs": float(sum(row["seconds"] for row in found)),
        "compiling [s]": clock.seconds - before,
    }, found


def _warm_up(task: Task, config: GPConfig) -> None:
    """Compiles what all runs share."""
    training = Training(task, dataclasses.replace(config, generations=2, seed=1 << 20), Settings())
    for _ in training.evolution.run():
        pass


if __name__ == "__main__":
    main(tyro.cli(Arguments))
