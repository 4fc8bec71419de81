"""When does planning alone do? The plan of every task, plans as the seed of evolution beside evolution alone, and the plans
of random tasks, with boxes or with objects of all shapes.

    python -m benchmarks.planning [--only packaged seeded]
    python -m benchmarks.planning --only random kits [--tasks 50] [--seed 0]
"""

from __future__ import annotations

import dataclasses
from time import perf_counter
from typing import Any, Literal

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Tree, Vocabulary, expand
from bt_jax.encoding.walk import leaves
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import plan, plan_task
from bt_jax.lfd.evaluation.random_kits import random_kit_task
from bt_jax.lfd.evaluation.random_tasks import random_task
from bt_jax.lfd.placements import condition_of
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
SEEDED = ("pyramid", "restack", "stack", "stack3", "yumi_stack")
BOXES, OBJECTS = (2, 3, 4, 5), (2, 4, 6, 8)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Planning on every task of the package, evolution seeded by the plan, and evolution alone; plans of random tasks."""

    only: tuple[Literal["packaged", "seeded", "random", "kits"], ...] = ("packaged", "seeded", "random", "kits")
    """packaged: plans of all packaged tasks; seeded: evolution with and without them; random, kits: plans of random tasks"""
    runs: int = 10
    """evolutions of each kind"""
    layouts: int = 100
    """unseen layouts in which trees are tested"""
    tasks: int = 50
    """random tasks for each number of boxes or objects"""
    task_layouts: int = 10
    """unseen layouts of each random task"""
    seed: int = 0
    """seed of the random tasks"""


def main(arguments: Arguments) -> None:
    configure_jax()
    if "random" in arguments.only:
        rows = [random_tasks("boxes", boxes, arguments) for boxes in BOXES]
        report("planning_random", "Plans of random tasks", rows, seed=arguments.seed)
    if "kits" in arguments.only:
        rows = [random_tasks("objects", objects, arguments) for objects in OBJECTS]
        report("planning_kits", "Plans of random kits", rows, seed=arguments.seed)
    if "packaged" in arguments.only:
        report("planning_packaged", "Plans of the packaged tasks", [packaged_task(n, arguments) for n in task_names()])
    if "seeded" in arguments.only:
        report("planning", "Planning alone, and as a seed", seeded_tasks(arguments))


def packaged_task(name: str, arguments: Arguments) -> dict[str, Any]:
    """How the plan of a task does in unseen layouts, and how long planning takes."""
    task = load_task(name)
    began = perf_counter()
    tree = plan_task(task)
    seconds = perf_counter() - began
    return {
        "task": name,
        "objects": len(task.objects),
        "targets": len(task.targets),
        "moves": moves_of(tree),
        "layouts": arguments.layouts,
        "layouts solved": round(
            arguments.layouts * layouts_solved(task, tree, seed=arguments.seed, count=arguments.layouts)
        ),
        "planning, s": round(seconds, 3),
    }


def seeded_tasks(arguments: Arguments) -> list[dict[str, Any]]:
    """How the plans of some tasks do, alone and as a seed, beside evolution alone."""
    rows = []
    for name in SEEDED:
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


def random_tasks(kind: Literal["boxes", "objects"], count: int, arguments: Arguments) -> dict[str, Any]:
    """How the plans of random tasks do, and those that know nothing of what stands in the way."""
    solved: list[float] = []
    blind: list[float] = []
    moves: list[float] = []
    for number in range(arguments.tasks):
        rng = np.random.default_rng([arguments.seed, count, number])
        if kind == "boxes":
            task = random_task(load_task("stack3"), boxes=count, rng=rng)
        else:
            task = random_kit_task(load_task("kit4"), objects=count, rng=rng)
        tree = plan_task(task)
        moves.append(moves_of(tree) / len(task.targets))
        parts = [name for name in task.instances if name not in task.object_names]
        for found, tried in ((solved, tree), (blind, plan(list(map(condition_of, task.targets)), parts=parts))):
            found.append(layouts_solved(task, tried, seed=number, count=arguments.task_layouts))
    return {
        kind: count,
        "tasks": arguments.tasks,
        "tasks solved in all layouts": int(sum(share == 1 for share in solved)),
        "layouts solved": f"{100 * np.mean(solved):.1f} %",
        "layouts solved by targets alone": f"{100 * np.mean(blind):.1f} %",
        "moves for each target, mean": round(float(np.mean(moves)), 2),
    }


def moves_of(tree: Tree) -> int:
    """The number of places that a plan may put something at."""
    return len({leaf for leaf in leaves(expand(tree)) if leaf.name == "place"})


def layouts_solved(task: Task, tree: Tree, *, seed: int, count: int) -> float:
    """The share of layouts in which a tree solves a task."""
    semantics = LeafSemantics(task, Vocabulary.of(leaves(tree)))
    settler, layouts = Settler(task, make_physics(task, "mujoco")), sample_layouts(task, [seed, 1], count)
    played = [play(semantics, settler, tree, take(layouts, slice(k, k + 1))) for k in range(count)]
    return float(np.mean([one.solved for one in played]))


if __name__ == "__main__":
    main(tyro.cli(Arguments))
