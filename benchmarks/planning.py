"""When does planning alone do? The plan of every task, alone and as the seed of evolution, beside evolution alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan_task
from bt_jax.tasks import Task, load_task, task_names
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

PAPER = {"restack": {"generations": 200, "population": 32, "p_add": 0.1, "p_delete": 0.3, "p_change": 0.6}}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Planning, evolution seeded by the plan, and evolution alone, on every task of the package."""

    runs: int = 10
    """evolutions of each kind"""
    layouts: int = 100
    """unseen layouts in which trees are tested"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    rows = []
    for name in task_names():
        task = load_task(name)
        config = GPConfig(runs=arguments.runs, **PAPER.get(name, {"generations": 100}))
        plan = plan_task(task)
        tried = Training(task, config, Settings(test_layouts=arguments.layouts), baseline=plan).test(plan)
        seeded, alone = (evolved(task, config, baseline, arguments.layouts) for baseline in (plan, None))
        rows.append(
            {
                "task": name,
                "plan solves": f"{100 * tried.success_rate:.0f} %",
                "plan, fitness": float(tried.fitness.mean()),
                "seeded, fitness": seeded[0],
                "seeded, unseen layouts": f"{100 * seeded[1]:.0f} %",
                "GP alone, fitness": alone[0],
                "GP alone, unseen layouts": f"{100 * alone[1]:.0f} %",
                "generations": config.generations,
                "population": config.population,
            }
        )
    report("planning", "Planning alone, and as a seed", rows, out=arguments.out)


def evolved(task: Task, config: GPConfig, baseline: Tree | None, layouts: int) -> tuple[float, float]:
    """Mean over the runs of the best fitness, and of the share of unseen layouts that the best tree solves."""
    training = Training(task, config, Settings(test_layouts=layouts), baseline=baseline)
    *_, state = training.evolution.run()
    best = np.asarray(state.population.fitness).max(axis=1)
    return float(best.mean()), float(np.mean([training.test(tree).success_rate for tree in training.best_trees(state)]))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
