"""How well does evolution learn? The paper's experiments with GP alone, its table I, and the published curves beside."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import Tree
from bt_jax.encoding.arrays import encode_all
from bt_jax.experiments.published import published_curves
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

RESTACK = {
    "method": "population",
    "runs": 40,
    "generations": 200,
    "population": 32,
    "p_add": 0.1,
    "p_delete": 0.3,
    "p_change": 0.6,
}
PUBLISHED = {"old_share": 0.1, "chain_ratio": 1.0}  # rules of the published runs that are not in table I
EXPERIMENTS = {  # task, published experiment, settings
    "stack": ("stack", "1", GPConfig(method="population", generations=50, runs=20)),
    "stack, 200 runs": ("stack", "1", GPConfig(method="population", generations=50, runs=200, seed=1000)),
    "stack, 200 runs, published rules": (
        "stack",
        "1",
        GPConfig(method="population", generations=50, runs=200, seed=1000, **PUBLISHED),
    ),
    "pyramid": ("pyramid", "2", GPConfig(method="population", generations=100, runs=10)),
    "restack": ("restack", "3", GPConfig(**RESTACK)),
    "restack, published rules": ("restack", "3", GPConfig(**RESTACK, **PUBLISHED)),
    "restack, other seeds": ("restack", "3", GPConfig(**RESTACK, seed=1000)),
    "restack, other seeds, published rules": ("restack", "3", GPConfig(**RESTACK, **PUBLISHED, seed=1000)),
    "restack, subgoal seen": ("restack", "3", GPConfig(**RESTACK)),
}
SEEN = ("restack, subgoal seen",)  # with the other rule for subgoals than the published one
DRAWN = ("stack", "pyramid", "restack")
CHANGED_AT = {"1": 50}  # generation from which the published curve has another target


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Learning curves with the settings of the paper's table I."""

    only: tuple[str, ...] = tuple(EXPERIMENTS)
    """rows to measure; the picture needs all"""
    solved: float = -35.0
    """fitness at which experiment 1a counts as solved"""
    figure: Path = Path(__file__).parents[1] / "docs" / "learning.png"
    """picture to draw"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    rows, curves = [], {}
    for name in arguments.only:
        task_name, experiment, config = EXPERIMENTS[name]
        began, task = perf_counter(), load_task(task_name)
        if name in SEEN:
            task = dataclasses.replace(task, subgoal_reward="seen")
        training = Training(task, config, Settings())
        best = []
        for state in training.evolution.run():
            best.append(np.asarray(state.population.fitness).max(axis=1))
        seconds = perf_counter() - began
        best = np.array(best).T
        curve = published_curves()[int(experiment), "gp_only"]
        published = dict(zip(curve.generations, curve.mean, strict=True))
        curves[name] = (best, published)
        trees = training.best_trees(state)
        success = [int(training.test(tree).solved.sum()) for tree in trees[:20]]
        last = min(best.shape[1] - 1, CHANGED_AT.get(experiment, 1 << 30) - 1, max(published))
        rows.append(
            {
                "task": name,
                "runs": config.runs,
                "generations": config.generations,
                "best, mean": float(best[:, -1].mean()),
                "std": float(best[:, -1].std()),
                "worst": float(best[:, -1].min()),
                "best run": float(best[:, -1].max()),
                "published mean": published[last],
                "solved in its own layout": _solved(training, trees),
                "at -35 or better": int((best[:, -1] >= arguments.solved).sum()),
                "episodes, mean": float(np.mean(state.trees_measured)),
                "episodes, most": int(max(state.trees_measured)),
                "unseen layouts solved of 100, worst of 20 runs": min(success),
                "seconds": seconds,
            }
        )
        print(rows[-1], flush=True)
    if set(DRAWN) <= set(curves):
        draw({name: curves[name] for name in DRAWN}, arguments.figure)
    report(
        "learning",
        "GP alone, settings of table I",
        rows,
        out=arguments.out,
        curves={name: np.round(best.astype(float), 1).tolist() for name, (best, _) in curves.items() if name in DRAWN},
    )


def _solved(training: Training, trees: list[Tree]) -> int:
    """How many runs end with a tree that solves the task in the layout of its run?"""
    population = encode_all(trees, training.vocabulary, training.config.max_nodes)
    which = np.arange(len(trees), dtype=np.int32)[:, None]
    return int(training.evaluator(population, training.layouts, which).solved.sum())


def draw(curves: dict, path: Path) -> None:
    """One panel a task: ours with its range over the runs, and the published mean."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), dpi=110, layout="constrained")
    for axes, (name, (best, published)) in zip(figure.subplots(1, len(curves)), curves.items(), strict=True):
        generations = np.arange(best.shape[1])
        axes.fill_between(generations, best.min(axis=0), best.max(axis=0), color="#0072b2", alpha=0.15, lw=0)
        axes.plot(generations, best.mean(axis=0), color="#0072b2", lw=2, label=f"bt_jax, {len(best)} runs")
        known = [g for g in published if g < best.shape[1] and g < CHANGED_AT.get(EXPERIMENTS[name][1], 1 << 30)]
        if known:
            axes.plot(known, [published[g] for g in known], color="#d55e00", ls="--", label="published, 10 runs")
        axes.set(title=name, xlabel="generation", ylim=(min(-800.0, 1.1 * best[:, :2].mean()), 0))
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, loc="lower right")
    figure.supylabel("best fitness")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
