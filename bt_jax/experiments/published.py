"""The published learning curves, where they are at hand."""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

from bt_jax.errors import UserError

__all__ = ["Curve", "find_curves", "read_curves"]


@dataclasses.dataclass(frozen=True)
class Curve:
    """Best fitness by generation, mean and standard deviation over 10 runs."""

    generations: tuple[int, ...]
    mean: tuple[float, ...]
    std: tuple[float, ...]

    def at(self, generation: int) -> float | None:
        """The mean in a generation, None where it was not published."""
        return dict(zip(self.generations, self.mean, strict=True)).get(generation)


def find_curves() -> Path | None:
    """The file with the published curves beside this checkout, None where there is none."""
    path = Path(__file__).parents[3] / "shared" / "reference" / "learning_curves.csv"
    return path if path.is_file() else None


def read_curves(path: Path) -> dict[tuple[int, str], Curve]:
    """Curves by experiment and variant. Raises UserError where the file is not of that kind."""
    points: dict[tuple[int, str], list[tuple[int, float, float]]] = {}
    try:
        with path.open(encoding="utf-8") as file:
            for row in csv.DictReader(file):
                key = int(row["experiment"]), row["variant"]
                values = int(row["generation"]), float(row["best_fitness_mean"]), float(row["best_fitness_std"])
                points.setdefault(key, []).append(values)
    except (OSError, KeyError, ValueError, TypeError) as error:
        raise UserError(f"{path} does not hold learning curves ({error}); leave out --published") from error
    return {key: Curve(*zip(*sorted(rows), strict=True)) for key, rows in points.items()}
