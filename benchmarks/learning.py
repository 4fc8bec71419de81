"""How well does evolution learn? The paper's experiments with GP alone, its table I, and the published curves; and the
method achievements, in as many generations."""

from __future__ import annotations

import dataclasses
import json
from datetime import date
from pathlib import Path
from time import perf_counter

import numpy as np
import tyro

from benchmarks._report import RESULTS, report
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
    "stack, achievements": ("stack", "1", GPConfig(generations=50, runs=20)),
    "pyramid, achievements": ("pyramid", "2", GPConfig(generations=100, runs=10)),
    "restack, achievements": ("restack", "3", GPConfig(generations=200, population=32, runs=40)),
}
SEEN = ("restack, subgoal seen",)  # with the other rule for subgoals than the published one
DRAWN = ("stack", "pyramid", "restack")
CURVES = tuple(name + variant for name in DRAWN for variant in ("", ", achievements"))
CHANGED_AT = {"1": 50}  # generation from which the published curve has another target


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Learning curves with the settings of the paper's table I."""

    only: tuple[str, ...] = tuple(EXPERIMENTS)
    """rows to measure; the others stay as the file of results has them"""
    solved: float = -35.0
    """fitness at which experiment 1a counts as solved"""
    figure: Path = Path(__file__).parents[1] / "docs" / "learning.png"
    """picture to draw"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    out = arguments.out or RESULTS / "learning.json"
    kept = json.loads(out.read_text(encoding="utf-8")) if out.exists() else {"rows": [], "curves": {}}
    rows, curves = {row["task"]: row for row in kept["rows"]}, kept["curves"]
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
        if name in CURVES:
            curves[name] = np.round(best.astype(float), 1).tolist()
        trees = training.best_trees(state)
        success = [int(training.test(tree).solved.sum()) for tree in trees[:20]]
        last = min(best.shape[1] - 1, CHANGED_AT.get(experiment, 1 << 30) - 1, max(published))
        rows[name] = {
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
            "date": date.today().isoformat(),
        }
        print(rows[name], flush=True)
    if set(CURVES) <= set(curves):
        draw({name: np.array(best) for name, best in curves.items()}, arguments.figure)
    ordered = [rows[name] for name in EXPERIMENTS if name in rows]
    report("learning", "GP alone, settings of table I", ordered, out=out, curves=curves)


def _solved(training: Training, trees: list[Tree]) -> int:
    """How many runs end with a tree that solves the task in the layout of its run?"""
    population = encode_all(trees, training.vocabulary, training.config.max_nodes)
    which = np.arange(len(trees), dtype=np.int32)[:, None]
    return int(training.evaluator(population, training.layouts, which).solved.sum())


def draw(curves: dict[str, np.ndarray], path: Path) -> None:
    """One panel a task: ours by both methods, with their ranges over the runs, and the published mean."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.9), dpi=110, layout="constrained")
    panels = figure.subplots(1, len(DRAWN))
    for axes, name in zip(panels, DRAWN, strict=True):
        experiment = EXPERIMENTS[name][1]
        for variant, color, label in (
            ("", "#0072b2", "population"),
            (", achievements", "#009e73", "achievements"),
        ):
            best = curves[name + variant]
            generations = np.arange(best.shape[1])
            axes.fill_between(generations, best.min(axis=0), best.max(axis=0), color=color, alpha=0.15, lw=0)
            axes.plot(generations, best.mean(axis=0), color=color, lw=2, label=f"method {label}")
        curve = published_curves()[int(experiment), "gp_only"]
        known = dict(zip(curve.generations, curve.mean, strict=True))
        shown = [at for at in known if at < min(best.shape[1], CHANGED_AT.get(experiment, 1 << 30))]
        axes.plot(shown, [known[at] for at in shown], color="#d55e00", ls="--", label="published, 10 runs")
        axes.set(title=f"{name}, {len(curves[name])} runs", xlabel="generation")
        axes.set(ylim=(min(-800.0, 1.1 * curves[name][:, :2].mean()), 0))
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    figure.legend(*panels[0].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=3)
    figure.supylabel("best fitness")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
