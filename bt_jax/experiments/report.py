"""What the experiments came to: a figure each, a table, and a report with the trees."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np

from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.experiments.protocol import Experiment, Outcome
from bt_jax.experiments.published import Curve
from bt_jax.lfd.explanation import action_rows

__all__ = ["figure", "markdown", "table"]

Curves = Mapping[tuple[int, str], Curve]
COLORS = {"with_demonstration": "#0072b2", "gp_only": "#d55e00"}
NAMES = {"with_demonstration": "with demonstration", "gp_only": "GP only"}


def figure(outcomes: Sequence[Outcome], curves: Curves) -> bytes:
    """PNG of one experiment: best fitness over the generations, mean and range over the runs, the published means dashed."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    drawing = Figure(figsize=(7, 4.2), dpi=120, layout="constrained")
    FigureCanvasAgg(drawing)
    axes = drawing.add_subplot()
    experiment = outcomes[0].experiment
    for outcome in outcomes:
        color, generations = COLORS[outcome.variant], np.arange(outcome.best.shape[1])
        axes.fill_between(
            generations, outcome.best.min(axis=0), outcome.best.max(axis=0), color=color, alpha=0.15, lw=0
        )
        label = f"{NAMES[outcome.variant]}, {len(outcome.best)} runs"
        axes.plot(generations, outcome.best.mean(axis=0), color=color, lw=2, label=label)
        curve = curves[experiment.number, outcome.variant]
        label = f"published, {NAMES[outcome.variant]}"
        axes.plot(curve.generations, curve.mean, color=color, ls="--", lw=1.4, label=label)
    if experiment.change_at:
        axes.axvline(experiment.change_at, color="#999999", lw=1)
    axes.set_yscale("symlog", linthresh=100)
    low = min(float(outcome.best.min()) for outcome in outcomes)
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


def table(outcomes: Sequence[Outcome], curves: Curves) -> list[dict[str, str]]:
    """One row for each experiment and variant, at its last generation."""
    rows = []
    for outcome in outcomes:
        last, experiment = outcome.best[:, -1], outcome.experiment
        published = curves[experiment.number, outcome.variant]
        rows.append(
            {
                "experiment": str(experiment.number),
                "variant": NAMES[outcome.variant],
                "generation": str(outcome.best.shape[1] - 1),
                "best fitness, mean ± std": f"{last.mean():.1f} ± {last.std():.1f}",
                "worst run": f"{last.min():.1f}",
                "best run": f"{last.max():.1f}",
                "published mean": f"{published.last:.0f}",
                f"at {experiment.wanted:g} or better": f"{(last >= experiment.wanted).sum()} of {len(last)}",
                "episodes a run": f"{np.mean(outcome.episodes):,.0f}",
                "unseen layouts solved": f"{100 * np.mean(outcome.solved_unseen):.0f} %",
                "seconds (of it compiling)": f"{outcome.seconds:.1f} ({outcome.compile_seconds:.1f})",
            }
        )
    return rows


def markdown(outcomes: Sequence[Outcome], curves: Curves, *, machine: str) -> str:
    """The report: tables, figures, what was demonstrated, and the best and the worst tree of each variant."""
    parts = [
        "# Experiments 1 to 3\n",
        f"Evolution with a demonstration and alone, with the settings of the paper's table I. {machine}\n",
    ]
    for number in sorted({outcome.experiment.number for outcome in outcomes}):
        these = [outcome for outcome in outcomes if outcome.experiment.number == number]
        experiment = these[0].experiment
        parts.append(f"## Experiment {number}: {experiment.title}\n")
        parts.append(_markdown_table(table(these, curves)))
        parts.append(f"![Best fitness over the generations](experiment_{number}.png)\n")
        parts += [_lesson(experiment, outcome) for outcome in these if outcome.lesson is not None]
        parts += [_trees(outcome) for outcome in these]
    return "\n".join(parts)


def _markdown_table(rows: Sequence[Mapping[str, str]]) -> str:
    lines = [f"| {' | '.join(rows[0])} |", f"|{'---|' * len(rows[0])}"]
    return "\n".join([*lines, *(f"| {' | '.join(row.values())} |" for row in rows)]) + "\n"


def _lesson(experiment: Experiment, outcome: Outcome) -> str:
    assert outcome.lesson is not None
    steps = " ".join(experiment.script.split())
    inferred = "\n".join(f"- {row['what']} ({row['seen']}): {row['why']}" for row in action_rows(outcome.lesson))
    return f"Demonstrated {experiment.demonstrations} times: `{steps}`. Inferred:\n\n{inferred}\n"


def _trees(outcome: Outcome) -> str:
    last = outcome.best[:, -1]
    best, worst = int(last.argmax()), int(last.argmin())
    shown = {"best": best} if last[worst] == last[best] else {"best": best, "worst": worst}
    return "\n".join(
        f"{NAMES[outcome.variant]}, {name} run (fitness {last[run]:.1f}; first generation with leaves of the "
        f"baseline: {_entered(outcome, run)}):\n\n```\n{draw_text(outcome.trees[run])}```\n"
        for name, run in shown.items()
    )


def _entered(outcome: Outcome, run: int) -> str:
    """When a leaf of the baseline first was in the best tree, and where."""
    rows = [row for row in outcome.history if row.run == run and row.baseline_leaves > 0]
    return f"{rows[0].generation}, under child {rows[0].baseline_child} of the root" if rows else "none"
