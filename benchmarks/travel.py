"""Does a price for driving teach evolution in which order to carry? Metres driven, beside those of all orders."""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Control, Tree, Vocabulary
from bt_jax.encoding.walk import leaves
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.episodes.survey import survey
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Task, load_task
from bt_jax.training.levels import make_level
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

SWAP = Path(__file__).parent / "tasks" / "mobile_swap.yaml"
PRICES = (0.0, 5.0)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Evolve trees that swap blocks between two sides of a room, with and without a price for driving."""

    seeds: int = 10
    """evolutions of each kind"""
    first_seed: int = 11_000
    """the seed of the first"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    rows = []
    for price in PRICES:
        task = load_task(SWAP)
        task = dataclasses.replace(task, weights=dataclasses.replace(task.weights, travel=price))
        trees = []
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            training = Training(task, GPConfig(seed=seed), Settings(level="kinematic"))
            *_, last = training.evolution.run()
            trees.append(training.best_tree(last))
        rows.append(_row(task, f"weights.travel {price:g}", trees))
        orders = [Control.sequence(*order) for order in itertools.permutations(trees[0].children)]
    rows.append(_row(task, "every order of the four", orders))
    seeds = f"seeds {arguments.first_seed} to {arguments.first_seed + arguments.seeds - 1}"
    report("travel", f"mobile_swap, kinematic, {seeds}", rows, out=arguments.out, seeds=seeds)


def _row(task: Task, name: str, trees: list[Tree]) -> dict:
    """Return how far the robot drives in the one layout that the task has."""
    physics, layout = make_level(task, Settings(level="kinematic")), sample_layouts(task, 0, 1)
    results = [survey(LeafSemantics(task, Vocabulary.of(leaves(tree))), physics, tree, layout) for tree in trees]
    metres = np.array([result.travel[0, 0] for result in results if result.solved[0, 0]])
    return {
        "trees": name,
        "solved": f"{len(metres)} of {len(trees)}",
        "metres, mean": round(float(metres.mean()), 1),
        "metres, spread": round(float(metres.std()), 1),
        "metres, least": round(float(metres.min()), 1),
        "metres, most": round(float(metres.max()), 1),
    }


if __name__ == "__main__":
    main(tyro.cli(Arguments))
