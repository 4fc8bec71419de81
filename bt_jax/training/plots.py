"""Learning curves as pictures."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Literal

import numpy as np

from bt_jax.gp.evolution import Generation

__all__ = ["learning_curve"]

BEST, MEAN = "#0072b2", "#999999"
LINEAR = 100  # fitness down to -100 is drawn on a linear axis


def learning_curve(
    history: list[Generation], *, title: str, phases: Sequence[int] = (), kind: Literal["png", "svg"] = "png"
) -> bytes:
    """Return a picture of the fitness over the generations: best (mean and range over the runs) and mean of the population.
    A line marks each generation at which the task changed. Below -100 the axis is logarithmic."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    runs = 1 + max(row.run for row in history)
    generations = [row.generation for row in history if row.run == 0]
    best = np.array([[row.best for row in history if row.run == run] for run in range(runs)])
    mean = np.array([[row.mean for row in history if row.run == run] for run in range(runs)])
    figure = Figure(figsize=(6.4, 4), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    axes.plot(generations, mean.mean(axis=0), color=MEAN, lw=1.2, label="mean of the population")
    if runs > 1:
        axes.fill_between(generations, best.min(axis=0), best.max(axis=0), color=BEST, alpha=0.2, lw=0, label="range")
    label = f"best, mean of {runs} runs" if runs > 1 else "best"
    axes.plot(generations, best.mean(axis=0), color=BEST, lw=2, label=label)
    for i, phase in enumerate(phases):
        axes.axvline(phase, color="black", lw=1, ls=":", label="" if i else "task changed")
    axes.set_yscale("symlog", linthresh=LINEAR)
    axes.set_ylim(top=0)
    ticks = [-10_000, -3000, -1000, -300, -100, -50, 0]
    low = min(mean.min(), best.min())
    axes.set_yticks([t for t in ticks if t >= 1.5 * low], [f"{t}" for t in ticks if t >= 1.5 * low])
    axes.minorticks_off()
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="generation", ylabel=f"fitness (logarithmic below -{LINEAR})", title=title)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="lower right", frameon=False)
    out = io.BytesIO()
    with rc_context({"svg.fonttype": "none"}):  # text stays text, in the font of who looks at it
        figure.savefig(out, format=kind)
    return out.getvalue()
