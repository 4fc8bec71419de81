"""How do episodes and time to a solution grow with the number of objects, and those of the published procedure?"""

from __future__ import annotations

import dataclasses
import itertools
from pathlib import Path
from time import perf_counter
from typing import Literal

import numpy as np
import tyro

from benchmarks._kits import kit, tower
from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.encoding.arrays import encode_all
from bt_jax.gp.config import GPConfig, Method
from bt_jax.gp.evolution import State
from bt_jax.tasks import Task
from bt_jax.training.published import published_config
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

KINDS = {"kits": kit, "towers": tower}
NAMES: dict[Method, str] = {"achievements": "this method", "population": "published procedure"}
COLORS = {"kits": "#0072b2", "towers": "#d55e00"}
STYLES = ("o-", "s--")
COLUMNS = ("episodes", "seconds")


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Evolve trees for kits and towers of more and more objects until one solves the task, as long as any run does."""

    kits: tuple[int, ...] = (2, 3, 4, 6, 9, 12)
    """numbers of objects, 12 at most"""
    towers: tuple[int, ...] = (2, 3, 4, 5, 6, 8)
    """numbers of blocks, 8 at most"""
    seeds: int = 10
    """runs of this method for each number"""
    published_seeds: int = 5
    """runs of the published procedure for each number"""
    first_seed: int = 8100
    """the first of the seeds, of both"""
    episodes: int = 20_000
    """most episodes of a run"""
    level: Literal["physics", "kinematic"] = "kinematic"
    """physics or kinematic"""
    figure: Path = Path(__file__).parents[1] / "docs" / "scaling.png"
    """picture to draw"""
    out: Path | None = None
    """JSON file to write"""


@dataclasses.dataclass(frozen=True)
class Run:
    """One run until its best tree solves the task, or until it has spent its episodes: distinct trees measured."""

    solved: bool
    episodes: int
    seconds: float  # without compiling


def main(arguments: Arguments) -> None:
    configure_jax()
    rows = []
    with CompileClock() as clock:
        for method in NAMES:
            for kind, make in KINDS.items():
                for count in getattr(arguments, kind):
                    runs = _runs(make(count), method, arguments, clock)
                    rows.append({"tasks": kind, "method": NAMES[method], "objects": count} | _summary(runs))
                    print(rows[-1], flush=True)
                    if not rows[-1]["solved"]:
                        break  # nor would more objects be
    exponents, ratios = exponents_of(rows), ratios_of(rows)
    title = f"{arguments.level}, {arguments.episodes:,} episodes at most"
    draw(rows, exponents, arguments.episodes, arguments.figure)
    print(f"exponents: {exponents}\npublished procedure / this method, median episodes: {ratios}")
    report("scaling", title, rows, out=arguments.out, exponents=exponents, ratios=ratios, budget=arguments.episodes)


def _runs(task: Task, method: Method, arguments: Arguments, clock: CompileClock) -> list[Run]:
    count = arguments.seeds if method == "achievements" else arguments.published_seeds
    first = arguments.first_seed
    return [_run(task, method, seed, arguments, clock) for seed in range(first, first + count)]


def _run(task: Task, method: Method, seed: int, arguments: Arguments, clock: CompileClock) -> Run:
    before, began = clock.seconds, perf_counter()
    most = arguments.episodes  # generations never end before the episodes do
    config = published_config(task.name, seed=seed) if method == "population" else GPConfig(seed=seed)
    training = Training(task, dataclasses.replace(config, generations=most), Settings(level=arguments.level))
    best, solved = -np.inf, False
    for state in training.evolution.run():
        if (fitness := float(np.max(state.population.fitness))) > best:
            best, solved = fitness, _solves(training, state)
        if solved or state.trees_measured[0] >= most:
            break
    return Run(solved, state.trees_measured[0], perf_counter() - began - (clock.seconds - before))


def _solves(training: Training, state: State) -> bool:
    """Return whether the best tree solves the task in the layout of the run."""
    trees = encode_all([training.best_tree(state)], training.vocabulary, training.config.max_nodes)
    return bool(training.evaluator(trees, training.layouts).solved.all())


def _summary(runs: list[Run]) -> dict:
    """Return medians over all runs, where those that are not solved are worse than all others; None for these."""
    solved = np.array([run.solved for run in runs])
    episodes, seconds = (
        np.median(np.where(solved, [getattr(run, name) for run in runs], np.inf)) for name in ("episodes", "seconds")
    )
    return {
        "runs": len(runs),
        "solved": int(solved.sum()),
        "episodes, median": float(episodes) if np.isfinite(episodes) else None,
        "episodes, most": max((run.episodes for run in runs if run.solved), default=None),
        "seconds, median": round(float(seconds), 3) if np.isfinite(seconds) else None,
        "seconds, most": round(max(run.seconds for run in runs), 3),
    }


def exponents_of(rows: list[dict]) -> dict[str, float]:
    """Return the slope of a line through the logarithms of medians and objects, for each line with three of them."""
    found = {}
    for kind, name, column in itertools.product(KINDS, NAMES.values(), COLUMNS):
        known = _medians(rows, kind, name, column)
        if len(known) >= 3:
            slope = np.polyfit(*np.log(np.array([*known.items()]).T), 1)[0]
            found[f"{kind}, {name}, {column}"] = round(float(slope), 2)
    return found


def ratios_of(rows: list[dict]) -> dict[str, float]:
    """Return how many times the episodes of this method the published procedure takes, wherever half of its runs solve."""
    ratios = {}
    for kind in KINDS:
        ours, published = (_medians(rows, kind, name, "episodes") for name in NAMES.values())
        ratios |= {f"{kind}, {count}": round(published[count] / ours[count], 1) for count in published if count in ours}
    return ratios


def _medians(rows: list[dict], kind: str, name: str, column: str) -> dict[int, float]:
    """Return the medians that are known, by number of objects."""
    chosen = [row for row in rows if row["tasks"] == kind and row["method"] == name]
    return {row["objects"]: row[f"{column}, median"] for row in chosen if row[f"{column}, median"] is not None}


def draw(rows: list[dict], exponents: dict[str, float], budget: int, path: Path) -> None:
    """Draw medians of episodes and of seconds against the number of objects, both axes logarithmic; an open triangle is a
    median beyond the budget."""
    from matplotlib.figure import Figure  # heavy

    figure = Figure(figsize=(10, 4.6), dpi=110, layout="constrained")
    counts = sorted({row["objects"] for row in rows})
    for axes, column in zip(figure.subplots(1, 2), COLUMNS, strict=True):
        for (kind, color), (name, style) in itertools.product(COLORS.items(), zip(NAMES.values(), STYLES, strict=True)):
            known = _medians(rows, kind, name, column)
            slope = exponents.get(f"{kind}, {name}, {column}")
            label = f"{kind}, {name}" + (f": exponent {slope:.1f}" if slope is not None else "")
            axes.plot(known.keys(), known.values(), style, color=color, lw=2, ms=6, label=label)
            beyond = [
                row["objects"]
                for row in rows
                if (row["tasks"], row["method"]) == (kind, name) and row["objects"] not in known
            ]
            if column == "episodes" and beyond:
                axes.plot(beyond, [budget] * len(beyond), "^", color=color, mfc="white", mew=1.5, ms=8)
        if column == "episodes":
            axes.axhline(budget, color="#999999", lw=1, ls=":", zorder=0)
            axes.annotate(f"{budget:,} episodes at most", (counts[0], budget), (0, -13), textcoords="offset points",
                          color="#666666", fontsize=9)  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel="objects", title=f"{column} until solved, median")
        axes.set_xticks(counts, [str(count) for count in counts])
        axes.minorticks_off()
        axes.yaxis.set_major_formatter("{x:,g}")
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.legend(frameon=False, fontsize=9, loc="upper left", bbox_to_anchor=(0, -0.14), handlelength=3)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
