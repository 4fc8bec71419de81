"""Where the demonstrations put an object, seen from above in one frame, as a small drawing."""

from __future__ import annotations

from html import escape

import numpy as np
from jaxtyping import Float

from bt_jax.app.units import length
from bt_jax.lfd import Lesson
from bt_jax.lfd.cluster_points import LEAST, cluster_points
from bt_jax.lfd.clustering import Candidate
from bt_jax.lfd.inference import Inference
from bt_jax.tasks import Task

__all__ = ["cluster_svg", "scores"]

SIDE, MARGIN = 96.0, 8.0  # pixels
ROOM = 1.3  # by which a drawing is larger than the cluster in it
BARS = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)  # lengths of the scale, metres


def cluster_svg(lesson: Lesson, inference: Inference, frame: str, *, task: Task) -> str:
    """Draw the places of an action as dots, one for each demonstration, their mean as a plus, and other places of the same
    object as crosses; right is right for a person in front of the scene, and a bar shows the scale."""
    own, others = (_seen(points, task) for points in cluster_points(lesson, inference, frame))
    centre = own.mean(axis=0)
    reach = max(LEAST, ROOM * float(np.abs(own - centre).max()))
    scale = (SIDE / 2 - MARGIN) / reach

    def at(point: Float[np.ndarray, "2"]) -> tuple[float, float]:
        x, y = (point - centre) * scale
        return SIDE / 2 + float(x), SIDE / 2 - float(y)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE:g} {SIDE + 14:g}" width="{SIDE:g}" '
        f'height="{SIDE + 14:g}" role="img"><title>{escape(f"{inference.object}, seen from {frame}")}</title>',
        f'<rect class="cluster-area" x="0.5" y="0.5" width="{SIDE - 1:g}" height="{SIDE - 1:g}" rx="3"/>',
    ]
    for point in others:
        x, y = at(point)
        if 0 < x < SIDE and 0 < y < SIDE:
            parts.append(f'<path class="cluster-other" d="M{x - 3:.1f} {y - 3:.1f}l6 6m0 -6l-6 6"/>')
    names = [one.name for one in lesson.demonstrations]
    for instance, point in zip(inference.instances, own, strict=True):
        x, y = at(point)
        away = length(float(np.linalg.norm(point - centre)))
        title = escape(f"{names[instance.demonstration]}: {away} from the mean")
        parts.append(f'<circle class="cluster-own" cx="{x:.1f}" cy="{y:.1f}" r="4.5"><title>{title}</title></circle>')
    x, y = at(centre)
    parts.append(f'<path class="cluster-mean" d="M{x - 4:.1f} {y:.1f}h8m-4 -4v8"/>')
    bar = max((length for length in BARS if length <= reach), default=BARS[0])
    size, end = length(bar), 2 + bar * scale
    parts.append(f'<path class="cluster-bar" d="M2 {SIDE + 4:g}v4H{end:.1f}v-4"/>')
    parts.append(f'<text class="cluster-text" x="{end + 4:.1f}" y="{SIDE + 10:g}">{size}</text>')
    return "".join([*parts, "</svg>"])


def scores(lesson: Lesson, inference: Inference) -> dict[str, Candidate | None]:
    """Return the frames that an action may be relative to, the best first, with their scores; None if there were too few
    demonstrations for scores."""
    found: dict[str, Candidate | None] = {one.frame: one for one in inference.candidates}
    for frame in lesson.demonstrations.frames.names:
        if frame != inference.object:
            found.setdefault(frame, None)
    return found


def _seen(points: Float[np.ndarray, "N 3"], task: Task) -> Float[np.ndarray, "N 2"]:
    """Return how far to the right and how far away points are for a person in front of the scene."""
    return points @ np.array([task.right, task.away]).T
