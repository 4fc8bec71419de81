"""The published learning curves: what the authors of the paper logged in 10 runs of each variant."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

__all__ = ["PublishedCurve", "published_curves"]

SOURCE = Path(__file__).with_name("published_curves.csv")


@dataclasses.dataclass(frozen=True)
class PublishedCurve:
    """Best fitness by generation, mean and standard deviation over 10 runs."""

    generations: tuple[int, ...]
    mean: tuple[float, ...]
    std: tuple[float, ...]

    @property
    def last(self) -> float:
        """The mean in the last generation that was published."""
        return self.mean[-1]


def published_curves() -> dict[tuple[int, str], PublishedCurve]:
    """Return the curves by experiment and variant."""
    points: dict[tuple[int, str], list[tuple[int, float, float]]] = {}
    with SOURCE.open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            key = int(row["experiment"]), row["variant"]
            values = int(row["generation"]), float(row["best_fitness_mean"]), float(row["best_fitness_std"])
            points.setdefault(key, []).append(values)
    return {key: PublishedCurve(*zip(*sorted(rows), strict=True)) for key, rows in points.items()}
