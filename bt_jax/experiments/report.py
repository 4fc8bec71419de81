"""The results of the experiments: a figure each, a table, and a report with the trees."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np

from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.experiments.protocol import Experiment, VariantResult
from bt_jax.experiments.published import PublishedCurve
from bt_jax.lfd.explanation import action_rows

__all__ = ["figure", "markdown", "table"]

Curves = Mapping[tuple[int, str], PublishedCurve]
COLORS = {"with_demonstration": "#0072b2", "gp_only": "#d55e00", "achievements": "#009e73"}
NAMES = {
    "with_demonstration": "with demonstration",
    "gp_only": "GP only",
    "achievements": "GP only, method achievements",
}


def figure(results: Sequence[VariantResult], curves: Curves) -> bytes:
    """Return a PNG of one experiment: best fitness over the generations, mean and range over the runs, the published
    means dashed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(7, 4.2), dpi=120, layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.add_subplot()
    experiment = results[0].experiment
    for result in results:
        color, generations = COLORS[result.variant], np.arange(result.best.shape[1])
        axes.fill_between(generations, result.best.min(axis=0), result.best.max(axis=0), color=color, alpha=0.15, lw=0)
        label = f"{NAMES[result.variant]}, {len(result.best)} runs"
        axes.plot(generations, result.best.mean(axis=0), color=color, lw=2, label=label)
        if curve := curves.get((experiment.number, result.variant)):
            label = f"published, {NAMES[result.variant]}"
            axes.plot(curve.generations, curve.mean, color=color, ls="--", lw=1.4, label=label)
    if experiment.change_at:
        axes.axvline(experiment.change_at, color="#999999", lw=1)
    axes.set_yscale("symlog", linthresh=100)
    low = min(float(result.best.min()) for result in results)
    ticks = [tick for tick in (-10_000, -3000, -1000, -300, -100, -50, 0) if tick >= 1.5 * low]
    axes.set_ylim(top=0)
    axes.set_yticks(ticks, [f"{tick}" for tick in ticks])
    axes.minorticks_off()
    axes.set(xlabel="generation", ylabel="best fitness", title=f"Experiment {experiment.number}")
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="lower right", fontsize=9)
    out = io.BytesIO()
    drawing.savefig(out, format="png")
    return out.getvalue()


def table(results: Sequence[VariantResult], curves: Curves) -> list[dict[str, str]]:
    """Return one row for each experiment and variant, at its last generation."""
    rows = []
    for result in results:
        last, experiment = result.best[:, -1], result.experiment
        published = curves.get((experiment.number, result.variant))
        rows.append(
            {
                "experiment": str(experiment.number),
                "variant": NAMES[result.variant],
                "generation": str(result.best.shape[1] - 1),
                "best fitness, mean ± std": f"{last.mean():.1f} ± {last.std():.1f}",
                "worst run": f"{last.min():.1f}",
                "best run": f"{last.max():.1f}",
                "published mean": f"{published.last:.0f}" if published else "",
                f"at {experiment.wanted:g} or better": f"{(last >= experiment.wanted).sum()} of {len(last)}",
                "episodes a run": f"{np.mean(result.episodes):,.0f}",
                "unseen layouts solved": f"{100 * np.mean(result.solved_unseen):.0f} %",
                "seconds (of it compiling)": f"{result.seconds:.1f} ({result.compile_seconds:.1f})",
            }
        )
    return rows


def markdown(results: Sequence[VariantResult], curves: Curves, *, machine: str) -> str:
    """Return the report: tables, figures, what was demonstrated, and the best and the worst tree of each variant."""
    parts = [
        "# Experiments 1 to 3\n",
        "Evolution with a demonstration and alone, with the settings of the paper's table I, and alone by the method "
        f"achievements, with the same population and generations. {machine}\n",
    ]
    for number in sorted({result.experiment.number for result in results}):
        these = [result for result in results if result.experiment.number == number]
        experiment = these[0].experiment
        parts.append(f"## Experiment {number}: {experiment.title}\n")
        parts.append(_markdown_table(table(these, curves)))
        parts.append(f"![Best fitness over the generations](experiment_{number}.png)\n")
        parts += [_lesson(experiment, result) for result in these if result.lesson is not None]
        parts += [_trees(result) for result in these]
    return "\n".join(parts)


def _markdown_table(rows: Sequence[Mapping[str, str]]) -> str:
    lines = [f"| {' | '.join(rows[0])} |", f"|{'---|' * len(rows[0])}"]
    return "\n".join([*lines, *(f"| {' | '.join(row.values())} |" for row in rows)]) + "\n"


def _lesson(experiment: Experiment, result: VariantResult) -> str:
    assert result.lesson is not None
    steps = " ".join(experiment.script.split())
    inferred = "\n".join(f"- {row['what']} ({row['seen']}): {row['why']}" for row in action_rows(result.lesson))
    return f"Demonstrated {experiment.demonstrations} times: `{steps}`. Inferred:\n\n{inferred}\n"


def _trees(result: VariantResult) -> str:
    last = result.best[:, -1]
    best, worst = int(last.argmax()), int(last.argmin())
    shown = {"best": best} if last[worst] == last[best] else {"best": best, "worst": worst}
    return "\n".join(
        f"{NAMES[result.variant]}, {name} run (fitness {last[run]:.1f}; first generation with leaves of the "
        f"baseline: {_entered(result, run)}):\n\n```\n{draw_text(result.trees[run])}```\n"
        for name, run in shown.items()
    )


def _entered(result: VariantResult, run: int) -> str:
    """Return when a leaf of the baseline first was in the best tree, and where."""
    rows = [row for row in result.history if row.run == run and row.baseline_leaves > 0]
    return f"{rows[0].generation}, under child {rows[0].baseline_child} of the root" if rows else "none"
