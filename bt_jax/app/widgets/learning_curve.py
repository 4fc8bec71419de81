"""Learning curves for the page, as options of Apache ECharts."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

__all__ = ["LearningCurve", "curve_options"]

POINTS = 240  # of one line, at most
BLUE, ORANGE, GREY = "#0072b2", "#e69f00", "#8a94a0"
GREEN, VERMILION, PURPLE = "#009e73", "#d55e00", "#cc79a7"
COLORS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE)
STROKES = ("solid", "dashed", "dotted")  # with the colours, 15 curves look different
SMALLEST = 1.0  # cost that the logarithmic axis still shows


@dataclasses.dataclass(frozen=True)
class LearningCurve:
    """The history of one run: rows of generation, best, mean; `phases` are the generations at which one began."""

    name: str
    history: Sequence[tuple[int, float, float]]
    phases: Sequence[int] = ()


def curve_options(curves: Sequence[LearningCurve], *, generations: int = 0) -> dict[str, Any]:
    """Return the chart of the best fitness of each run over the generations; for a single run, with the population's mean.

    The axis is logarithmic in the cost, which is the negative fitness, and grows downwards.
    """
    series = []
    for color, stroke, curve in zip(itertools.cycle(COLORS), itertools.cycle(STROKES), curves, strict=False):
        rows = _thinned(curve.history)
        name = curve.name if len(curves) > 1 else "best"
        series.append(_line(name, [(row[0], row[1]) for row in rows], color, stroke, width=2.5))
        if curve.phases:
            series[-1]["markLine"] = {
                "symbol": "none",
                "silent": True,
                "lineStyle": {"color": GREY, "type": "dotted"},
                "label": {"formatter": "taught", "position": "start", "color": "#56616d"},
                "data": [{"xAxis": generation} for generation in curve.phases],
            }
        if len(curves) == 1:
            series.append(_line("mean of the population", [(row[0], row[2]) for row in rows], GREY, "solid", width=1.2))
    last = max([generations, 1, *(row[0] for curve in curves for row in curve.history[-1:])])
    return {
        "animation": False,
        "grid": {"left": 64, "right": 16, "top": 44, "bottom": 38},
        "legend": {"type": "scroll", "top": 0, "left": 64, "right": 8, "itemHeight": 3, "icon": "rect"},
        "tooltip": {"trigger": "axis", ":valueFormatter": "cost => (-cost).toFixed(1)"},
        "xAxis": {
            "type": "value",
            "min": 0,
            "max": last,
            "name": "generation",
            "nameLocation": "middle",
            "nameGap": 22,
            "minInterval": 1,
            "splitLine": {"show": False},
        },
        "yAxis": {
            "type": "log",
            "inverse": True,
            "name": "score",
            "nameLocation": "middle",
            "nameGap": 46,
            "axisLabel": {":formatter": "cost => (-cost).toLocaleString('en-US')"},
            "min": 10,
        },
        "series": series,
    }


def _line(name: str, points: list[tuple[int, float]], color: str, stroke: str, *, width: float) -> dict[str, Any]:
    return {
        "name": name,
        "type": "line",
        "data": [[generation, max(-fitness, SMALLEST)] for generation, fitness in points],
        "symbol": "none",
        "color": color,
        "lineStyle": {"width": width, "type": stroke},
    }


def _thinned(rows: Sequence[tuple[int, float, float]]) -> list[tuple[int, float, float]]:
    """Return evenly chosen rows, the first and the last among them."""
    if len(rows) <= POINTS:
        return list(rows)
    step = (len(rows) - 1) / (POINTS - 1)
    return [rows[round(i * step)] for i in range(POINTS)]
