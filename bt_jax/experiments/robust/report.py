"""The results of the experiment on faults: a figure, a table, a comparison of pairs, and the trees."""

from __future__ import annotations

import dataclasses
import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool

from bt_jax._util.statistics import mcnemar, wilson
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.experiments.robust.models import ALL, CONDITIONS, MODELS, Model

__all__ = ["Outcomes", "comparison", "figure", "markdown", "rates"]

NAMES: dict[Model, str] = {
    "evolved_without": "evolved without faults",
    "evolved_with": "evolved with faults",
    "planned_without": "planned without faults",
    "planned_with": "planned with faults",
    "demonstrated": "demonstrated",
}
COLORS = ("#d55e00", "#0072b2", "#e69f00", "#56b4e9", "#009e73")


@dataclasses.dataclass(frozen=True)
class Outcomes:
    """The trees of one model for one task, one for each seed, and the episodes that they solve."""

    task: str
    model: Model
    trees: tuple[str, ...]
    solved: dict[str, Bool[np.ndarray, "seeds K"]]  # by condition

    @property
    def median(self) -> int:
        """The tree in the middle, by the episodes solved under all faults together; of an even number, the lower one."""
        order = np.argsort(self.solved[ALL].mean(axis=1), kind="stable")
        return int(order[(len(order) - 1) // 2])


def rates(tested: Sequence[Outcomes]) -> list[dict[str, str]]:
    """Return one row for each task and model: the share solved by the tree in the middle, with its interval of Wilson, and
    from the worst tree to the best where they differ; last the mean over the trees and their standard deviation."""
    rows = []
    for one in tested:
        row = {"task": one.task, "model": NAMES[one.model]}
        for condition in CONDITIONS:
            solved = one.solved[condition]
            middle, each = solved[one.median], 100 * solved.mean(axis=1)
            low, high = wilson(int(middle.sum()), len(middle))
            spread = f"; {each.min():.1f}-{each.max():.1f}" if np.ptp(each) else ""
            row[condition] = f"{100 * middle.mean():.1f} ({100 * low:.1f}-{100 * high:.1f}{spread})"
        shares = 100 * one.solved[ALL].mean(axis=1)
        deviation = f" ± {shares.std(ddof=1):.1f}" if len(shares) > 1 else ""
        row["all, mean of runs"] = f"{shares.mean():.1f}{deviation}"
        rows.append(row)
    return rows


def comparison(tested: Sequence[Outcomes]) -> list[dict[str, str]]:
    """Return for each task and seed how many episodes under all faults only the tree evolved with faults solves, how many
    only the one without, and the p-value of McNemar's test."""
    rows = []
    for task in dict.fromkeys(one.task for one in tested):
        with_, without = (
            next(one for one in tested if (one.task, one.model) == (task, model)).solved[ALL]
            for model in ("evolved_with", "evolved_without")
        )
        for seed, (a, b) in enumerate(zip(with_, without, strict=True)):
            only_with, only_without = int((a & ~b).sum()), int((b & ~a).sum())
            rows.append(
                {
                    "task": task,
                    "run": str(seed),
                    "both": str(int((a & b).sum())),
                    "only with faults": str(only_with),
                    "only without": str(only_without),
                    "neither": str(int((~a & ~b).sum())),
                    "p": f"{mcnemar(only_with, only_without):.1e}",
                }
            )
    return rows


def figure(tested: Sequence[Outcomes]) -> bytes:
    """Return a PNG: for each task and condition the share of episodes solved, that of the tree in the middle as a bar, from
    the worst tree to the best as a line."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # heavy: only a report draws
    from matplotlib.figure import Figure

    tasks = list(dict.fromkeys(one.task for one in tested))
    drawing = Figure(figsize=(9, 3.4 * len(tasks)), dpi=120, layout="constrained")
    FigureCanvasAgg(drawing)
    places, width = np.arange(len(CONDITIONS)), 0.8 / len(MODELS)
    for row, task in enumerate(tasks):
        axes = drawing.add_subplot(len(tasks), 1, row + 1)
        for i, model in enumerate(MODELS):
            one = next((one for one in tested if (one.task, one.model) == (task, model)), None)
            if one is None:
                continue
            each = np.array([100 * one.solved[condition].mean(axis=1) for condition in CONDITIONS])
            middle, at = each[:, one.median], places + (i - (len(MODELS) - 1) / 2) * width
            error = np.maximum(0, np.array([middle - each.min(axis=1), each.max(axis=1) - middle]))
            axes.bar(at, middle, width, color=COLORS[i], yerr=error, label=NAMES[model], error_kw={"lw": 0.8})
        axes.axhline(95, color="#999999", lw=0.8, ls="--")
        axes.set_xticks(places, CONDITIONS)
        axes.set(ylim=(0, 100), ylabel="episodes solved [%]", title=task)
        axes.spines[["top", "right"]].set_visible(False)
        if row == 0:
            names = axes.get_legend_handles_labels()
            drawing.legend(*names, frameon=False, loc="outside upper center", fontsize=8, ncols=len(MODELS))
    out = io.BytesIO()
    drawing.savefig(out, format="png")
    return out.getvalue()


def markdown(tested: Sequence[Outcomes], *, settings: dict[str, str], machine: str) -> str:
    """Return the report."""
    said = ", ".join(f"{name} {value}" for name, value in settings.items())
    parts = [
        "# Robust trees\n",
        f"Settings: {said}. {machine}\n",
        "Episodes solved, in percent: the tree in the middle of the runs (its 95 % interval of Wilson; from the worst run "
        "to the best where they differ); last the mean of the runs under all faults and its standard deviation.\n",
        _table(rates(tested)),
        "![Episodes solved under each fault](robust.png)\n",
        "Under all faults together, in the same episodes (McNemar's exact test):\n",
        _table(comparison(tested)),
    ]
    for one in tested:
        tree = one.trees[one.median]
        same = sum(other == tree for other in one.trees)
        count = f", the same in {same} of {len(one.trees)} runs" if len(one.trees) > 1 else ""
        parts.append(f"{one.task}, {NAMES[one.model]}{count}:\n\n```\n{draw_text(parse_tree(tree))}```\n")
    return "\n".join(parts)


def _table(rows: Sequence[dict[str, str]]) -> str:
    lines = [f"| {' | '.join(rows[0])} |", f"|{'---|' * len(rows[0])}"]
    return "\n".join([*lines, *(f"| {' | '.join(row.values())} |" for row in rows)]) + "\n"
