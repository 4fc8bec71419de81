"""Do the draws of the transition table bias the success of trees, and how often do its transitions come again?

The fittest trees that an evolution has measured run in the same layouts with the same fates, once over the table, where the
error of a place is one of 16 quasi-random draws, and once in rollouts, where it is Gaussian. All other faults are the same
in both.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import jax
import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.statistics import wilson
from bt_jax.behaviors import Tree
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.config import GPConfig
from bt_jax.lfd.planner import plan_task
from bt_jax.mjx_env.episodes.evaluator import TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import sample_episodes, sample_fates
from bt_jax.tasks import Faults, Task, load_faults, load_task, with_faults
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

UNSEEN = 7000  # seed of the layouts and fates
COARSE = Faults(place_spread=0.02, turn_spread=3.0)  # about a third of all places miss by more than the tolerance
CASES = {"harsh": (load_faults("harsh"), None), "places off by 20 mm, one try more": (COARSE, 1)}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """The table with 16 draws against rollouts with continuous errors."""

    task: str = "stack3"
    """packaged task"""
    trees: int = 200
    """evolved trees"""
    layouts: int = 20
    """layouts in which each tree runs"""
    draws: int = 5
    """draws of chance in each layout"""
    generations: int = 30
    """of the evolution that the trees come from"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    rows = [{"faults": name, **compare(arguments, *case)} for name, case in CASES.items()]
    report("faults", "success over the table and in rollouts", rows, out=arguments.out, task=arguments.task)


def compare(arguments: Arguments, faults: Faults, tries: int | None) -> dict[str, float]:
    """How often evolved trees succeed both ways, and by how much the mean differs, with the half width of its 95 % interval.
    Episodes of one fate are no independent ones, so that the interval is that of the mean over fates. With `tries`, there is
    time for so many picks and places more than one for each target."""
    task = with_faults(load_task(arguments.task), faults)
    if tries is not None:
        ticks = task.episode.success_ticks + 2 * (len(task.targets) + tries)
        task = dataclasses.replace(task, episode=dataclasses.replace(task.episode, max_ticks=ticks))
    training, trees = evolved(task, plan_task(load_task(arguments.task)), arguments)
    semantics, physics = training.table.semantics, training.level
    count, seed = len(trees.tokens), UNSEEN
    layouts, fates = sample_episodes(task, seed, layouts=arguments.layouts, draws=arguments.draws)
    gaussian = sample_fates(task, seed, layouts=arguments.layouts, draws=arguments.draws, continuous=True)
    table = TableEvaluator(semantics, physics, batch=count)
    ours = table(trees, layouts, fates=fates).solved
    theirs = RolloutEvaluator(semantics, physics, batch=count, on_host=True)(trees, layouts, fates=gaussian).solved
    by_fate = (ours.astype(float) - theirs).mean(axis=0)
    pairs = zip(ours.sum(axis=1).tolist(), theirs.sum(axis=1).tolist(), strict=True)
    intervals = [(wilson(a, ours.shape[1]), wilson(b, ours.shape[1])) for a, b in pairs]
    return {
        "trees": count,
        "episodes": ours.size,
        "table": float(ours.mean()),
        "rollout": float(theirs.mean()),
        "difference": float(by_fate.mean()),
        "half width": float(1.96 * by_fate.std(ddof=1) / math.sqrt(len(by_fate))),
        "intervals overlap": sum(a[0] <= b[1] and b[0] <= a[1] for a, b in intervals),
        "known before": table.hit_rate,
    }


def evolved(task: Task, plan: Tree, arguments: Arguments) -> tuple[Training, Trees]:
    """A training and the fittest distinct trees that it has measured in some generations, beginning with a plan."""
    config = GPConfig(population=32, generations=arguments.generations)
    training = Training(task, config, Settings(backend="mujoco"), baseline=plan)
    measured: dict[bytes, tuple[float, Trees]] = {}
    state = None
    for _ in range(1 + arguments.generations):
        state = training.evolution.step(state)
        trees, fitness = jax.device_get((state.population.trees, state.population.fitness))
        for tokens, sizes, value in zip(trees.tokens[0], trees.sizes[0], fitness[0].tolist(), strict=True):
            measured[tokens.tobytes()] = (value, Trees(tokens, sizes))
    best = sorted(measured.values(), key=lambda pair: -pair[0])[: arguments.trees]
    return training, Trees(np.stack([tree.tokens for _, tree in best]), np.stack([tree.sizes for _, tree in best]))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
