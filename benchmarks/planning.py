"""When does planning alone do? The plan of every task, alone and as the seed of evolution, beside evolution alone; and the
plans of random tasks.

    python -m benchmarks.planning [--only packaged]
    python -m benchmarks.planning --only random [--tasks 50] [--seed 0]
"""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Behavior, Tree, Vocabulary, expand
from bt_jax.encoding.walk import leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan, plan_task
from bt_jax.lfd.evaluation.random_tasks import random_task
from bt_jax.mjx_env.episodes.playback import play
from bt_jax.mjx_env.physics.factory import make_physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import take
from bt_jax.tasks import Task, load_task, task_names
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

PAPER = {"restack": {"generations": 200, "population": 32, "p_add": 0.1, "p_delete": 0.3, "p_change": 0.6}}
BOXES = (2, 3, 4, 5)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Planning, evolution seeded by the plan, and evolution alone on every task of the package; plans of random tasks."""

    only: tuple[Literal["packaged", "random"], ...] = ("packaged", "random")
    """which tasks"""
    runs: int = 10
    """evolutions of each kind"""
    layouts: int = 100
    """unseen layouts in which trees are tested"""
    tasks: int = 50
    """random tasks for each number of boxes"""
    task_layouts: int = 10
    """unseen layouts of each random task"""
    seed: int = 0
    """seed of the random tasks"""


def main(arguments: Arguments) -> None:
    configure_jax()
    if "random" in arguments.only:
        rows = [random_tasks(boxes, arguments) for boxes in BOXES]
        report("planning_random", "Plans of random tasks", rows, seed=arguments.seed)
    if "packaged" in arguments.only:
        report("planning", "Planning alone, and as a seed", packaged_tasks(arguments))


def packaged_tasks(arguments: Arguments) -> list[dict[str, Any]]:
    """How the plan of every task of the package does, alone and as a seed, beside evolution alone."""
    rows = []
    for name in task_names():
        task = load_task(name)
        config = GPConfig(method="population", runs=arguments.runs, **PAPER.get(name, {"generations": 100}))
        tree = plan_task(task)
        tried = Training(task, config, Settings(test_layouts=arguments.layouts), baseline=tree).test(tree)
        seeded, alone = (evolved(task, config, baseline, arguments.layouts) for baseline in (tree, None))
        rows.append(
            {
                "task": name,
                "plan solves": f"{100 * tried.success_rate:.0f} %",
                "plan, fitness": float(tried.fitness.mean()),
                "seeded, fitness": seeded[0],
                "seeded, unseen layouts": f"{100 * seeded[1]:.0f} %",
                "GP alone, fitness": alone[0],
                "GP alone, unseen layouts": f"{100 * alone[1]:.0f} %",
                "generations": config.num_generations,
                "population": config.population,
            }
        )
    return rows


def evolved(task: Task, config: GPConfig, baseline: Tree | None, layouts: int) -> tuple[float, float]:
    """Mean over the runs of the best fitness, and of the share of unseen layouts that the best tree solves."""
    training = Training(task, config, Settings(test_layouts=layouts), baseline=baseline)
    *_, state = training.evolution.run()
    best = np.asarray(state.population.fitness).max(axis=1)
    return float(best.mean()), float(np.mean([training.test(tree).success_rate for tree in training.best_trees(state)]))


def random_tasks(boxes: int, arguments: Arguments) -> dict[str, Any]:
    """How the plans of random tasks do, and those that know nothing of what stands in the way."""
    solved, blind, moves = [], [], []
    for number in range(arguments.tasks):
        rng = np.random.default_rng([arguments.seed, boxes, number])
        task = random_task(load_task("stack3"), boxes=boxes, rng=rng)
        tree = plan_task(task)
        moves.append(len({leaf for leaf in leaves(expand(tree)) if leaf.name == "place"}) / len(task.targets))
        goal = [Behavior("at", (target.object, target.position, target.frame)) for target in task.targets]
        for found, tried in ((solved, tree), (blind, plan(goal))):
            found.append(layouts_solved(task, tried, seed=number, count=arguments.task_layouts))
    return {
        "boxes": boxes,
        "tasks": arguments.tasks,
        "tasks solved in all layouts": int(sum(share == 1 for share in solved)),
        "layouts solved": f"{100 * np.mean(solved):.1f} %",
        "layouts solved by targets alone": f"{100 * np.mean(blind):.1f} %",
        "moves for each target, mean": round(float(np.mean(moves)), 2),
    }


def layouts_solved(task: Task, tree: Tree, *, seed: int, count: int) -> float:
    """The share of layouts in which a tree solves a task."""
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    settler, layouts = Settler(task, make_physics(task, "mujoco")), sample_layouts(task, [seed, 1], count)
    played = [play(semantics, settler, tree, take(layouts, slice(k, k + 1))) for k in range(count)]
    return float(np.mean([one.solved for one in played]))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
