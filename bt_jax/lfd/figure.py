"""The clusters that were compared, as a picture: one row an action, one panel a candidate frame."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.axes import Axes

from bt_jax.lfd.cluster_points import LEAST, cluster_points, cluster_turns
from bt_jax.lfd.clustering import Candidate
from bt_jax.lfd.inference import Inference
from bt_jax.lfd.learning import Lesson

__all__ = ["cluster_figure"]

CHOSEN, OTHER, BESIDES = "#0072b2", "#999999", "#d55e00"
ROWS = 12  # drawn at most; placements first


def cluster_figure(lesson: Lesson) -> bytes:
    """Draw a PNG: where the demonstrations put each object, seen from above in every candidate frame, each panel at its
    own scale. The chosen frame is blue; a plus is the mean of what agrees, an x another place of the same object. Bars along
    its x axis show how it was turned where that matters, and a diamond the middle of the slot that it is in."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = sorted(lesson.inferences, key=lambda one: one.kind != "place")[:ROWS]
    rows = [one for one in rows if one.kind == "place"] or rows
    frames = [_frames(lesson, inference) for inference in rows]
    columns = max(map(len, frames))
    size = (1.2 + 2.2 * columns, 0.6 + 2.4 * len(rows))
    figure = Figure(figsize=size, dpi=110, layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.subplots(len(rows), columns, squeeze=False)
    for axes, inference, names in zip(grid, rows, frames, strict=True):
        for axis, frame in zip(axes, names, strict=False):
            _panel(axis, lesson, inference, frame)
        for axis in axes[len(names) :]:
            axis.remove()
        axes[0].set_ylabel(f"{inference.kind} {inference.object}\n$y$ [m]")
    figure.supxlabel("$x$ [m]", fontsize=10)
    out = io.BytesIO()
    figure.savefig(out, format="png")
    return out.getvalue()


def _frames(lesson: Lesson, inference: Inference) -> list[str]:
    """Return the frames that an action is drawn in: all but those of what is placed."""
    names, own = lesson.demonstrations.frames.names, lesson.task.instances[inference.object]
    return [name for name in names if inference.kind == "pick" or name not in own]


def _panel(axes: Axes, lesson: Lesson, inference: Inference, frame: str) -> None:
    candidate = next((one for one in inference.candidates if one.frame == frame), None)
    own, others = cluster_points(lesson, inference, frame)
    chosen = frame == inference.frame
    mean = np.array(candidate.mean) if candidate is not None and candidate.size > 1 else None
    centre = own.mean(axis=0) if mean is None else mean
    axes.scatter(others[:, 0], others[:, 1], color=BESIDES, marker="x", s=28)
    axes.scatter(own[:, 0], own[:, 1], color=CHOSEN if chosen else OTHER, s=34, edgecolors="white", linewidths=0.6)
    if mean is not None:
        axes.scatter(mean[0], mean[1], color="black", marker="+", s=60, lw=1)
    if chosen and inference.turn is not None:
        turns = np.radians(cluster_turns(lesson, inference))
        bars = own[:, 0], own[:, 1], np.cos(turns), np.sin(turns)
        axes.quiver(*bars, pivot="mid", color=CHOSEN, scale=6, width=0.012, headwidth=1, headlength=0, headaxislength=0)
    marked = own[:, :2]
    if chosen and inference.slot:
        marked = np.vstack([own[:, :2], inference.position[:2]])
        axes.scatter(*inference.position[:2], facecolors="none", edgecolors="black", marker="D", s=52)
    reach = max(LEAST, 1.3 * float(np.abs(marked - centre[:2]).max()))
    axes.set_xlim(centre[0] - reach, centre[0] + reach)
    axes.set_ylim(centre[1] - reach, centre[1] + reach)
    axes.locator_params(nbins=5)
    axes.set_aspect("equal")
    named = inference.slot if chosen and inference.slot else frame
    axes.set_title(f"{named}\n{_score(candidate)}", fontsize=9, color=CHOSEN if chosen else "black")
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)
    if chosen:
        for spine in axes.spines.values():
            spine.set(color=CHOSEN, linewidth=2)


def _score(candidate: Candidate | None) -> str:
    if candidate is None:
        return "too few demonstrations"
    if candidate.size == 1:
        return "no agreement"
    return f"score {candidate.score:.0f}: {candidate.size} within {1000 * candidate.spread:.0f} mm"
