"""What an evolution has found."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32

from bt_jax._util.statistics import wilson
from bt_jax.behaviors import Tree
from bt_jax.encoding.drawing.svg import to_svg
from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.evolution import Generation, best_of
from bt_jax.mjx_env.faults.variants import bit
from bt_jax.tasks.faults import FAULTS
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.pictures import draw_pictures
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder

__all__ = ["EXPLAINED", "Failures", "Result", "Session", "Test"]

EXPLAINED = 100  # layouts, the first of those that a test does not solve; each is played again


@dataclasses.dataclass(frozen=True)
class Failures:
    """The episodes of a test that a tree does not solve for one reason: layouts, and where things go wrong also draws of
    chance, both numbered from 1."""

    reason: str
    layouts: tuple[int, ...]
    draws: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True)
class Test:
    """A tree in K episodes that it never saw: one in each layout, or where things go wrong several `draws` of chance, those
    of one layout side by side."""

    solved: Bool[np.ndarray, " K"]
    fitness: Float32[np.ndarray, " K"]
    failures: tuple[Failures, ...] = ()  # the most frequent reason first
    draws: int = 1
    struck: Int32[np.ndarray, " K"] | None = None  # faults that happened, as bits (see `faults.variants.bit`)

    @property
    def success_rate(self) -> float:
        """The share of the episodes that the tree solves."""
        return float(self.solved.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of the success rate with a coverage of 95 %, after Wilson."""
        return wilson(int(self.solved.sum()), len(self.solved))

    @property
    def by_fault(self) -> dict[str, tuple[int, int]]:
        """Of the episodes in which each fault happened, how many the tree solves, and how many there are."""
        if self.struck is None:
            return {}
        happened = {name: (self.struck & bit(name)) > 0 for name in FAULTS}
        return {name: (int(self.solved[on].sum()), int(on.sum())) for name, on in happened.items() if on.any()}

    def numbers(self, rows: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the layouts, and where things go wrong the draws, of some of the episodes, numbered from 1."""
        layouts = tuple(1 + row // self.draws for row in rows)
        return layouts, () if self.struck is None else tuple(1 + row % self.draws for row in rows)

    @property
    def unexplained(self) -> int:
        """How many episodes are not solved beyond those for which a reason is looked for."""
        return max(0, int((~self.solved).sum()) - EXPLAINED)


@dataclasses.dataclass(frozen=True)
class Session:
    """What one process did; a resumed run has several."""

    seconds: float  # of evolution
    compile_seconds: float  # of these
    broken: int  # simulations that diverged
    stopped: bool  # by the user
    generations: int = 1  # that it measured


@dataclasses.dataclass(frozen=True, repr=False)
class Result:
    """What R runs have found, and how they went: `trees` are the best of each, `test` is of the best of all."""

    config: RunConfig
    checkpoint: Checkpoint  # where the runs ended
    trees: list[Tree]
    test: Test

    @property
    def fitnesses(self) -> Float32[np.ndarray, " R"]:
        """The fitness of the best tree of each run."""
        return best_of(self.checkpoint.state)[1]

    @property
    def tree(self) -> Tree:
        """The best tree of all runs."""
        return self.trees[int(self.fitnesses.argmax())]

    @property
    def fitness(self) -> float:
        """Its fitness."""
        return float(self.fitnesses.max())

    @property
    def success_rate(self) -> float:
        """The share of episodes in unseen layouts that it solves."""
        return self.test.success_rate

    @property
    def history(self) -> list[Generation]:
        """One row for each generation and run."""
        return self.checkpoint.history

    @property
    def generations(self) -> int:
        """The last generation."""
        return self.checkpoint.state.generation

    @property
    def trees_measured(self) -> list[int]:
        """How many distinct trees each run has measured."""
        return self.checkpoint.state.trees_measured

    @property
    def episodes(self) -> list[int]:
        """How many episodes that took in each run."""
        return [count * self.config.settings.episodes(self.config.task) for count in self.trees_measured]

    @property
    def lines(self) -> list[str]:
        """The best tree of each run, on one line each."""
        return [one_line(tree) for tree in self.trees]

    @property
    def summary(self) -> str:
        """Task, fitness and success rate on one line."""
        of = "unseen layouts" if self.test.struck is None else "episodes in unseen layouts"
        solved = f"solves {self.success_rate:.0%} of {len(self.test.solved)} {of}"
        return f"{self.config.task.name}: fitness {self.fitness:.1f}, {solved}"

    def __repr__(self) -> str:
        return f"<Result of {self.summary}>"

    def __str__(self) -> str:
        return f"{self.summary}\n{draw_text(self.tree).rstrip()}"

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return f"<p>{escape(self.summary)}</p>{to_svg(self.tree)}"

    def save(self, path: str | Path) -> None:
        """Write a run folder with pictures, which `train --resume` and `run` take. Raise UserError if it is not empty."""
        folder = RunFolder.create(Path(path), self.config)
        folder.save_checkpoint(self.checkpoint)
        self.write(folder)
        draw_pictures(folder, self.config, self.tree, self.history)

    def write(self, folder: RunFolder, session: Session | None = None) -> None:
        """Write trees, history and `result.json` into a run folder."""
        folder.save_tree(self.tree, title=f"{self.config.task.name}: fitness {self.fitness:.1f}")
        folder.save_history(self.history)
        folder.save_result(self._as_data(session))

    def _as_data(self, session: Session | None) -> dict[str, Any]:
        return {
            "fitness": self.fitness,
            "success_rate": self.test.success_rate,
            "test_layouts": len(self.test.solved) // self.test.draws,
            "test_draws": self.test.draws,
            "success_interval": self.test.interval,
            "faults": {name: {"solved": k, "episodes": n} for name, (k, n) in self.test.by_fault.items()},
            "test_fitness_mean": float(self.test.fitness.mean()),
            "test_fitness_std": float(self.test.fitness.std()),
            "failures": [dataclasses.asdict(failures) for failures in self.test.failures],
            "failures_unexplained": self.test.unexplained,
            "generations": self.generations,
            "trees_measured": self.trees_measured,
            "episodes": self.episodes,
            "last_session": None if session is None else dataclasses.asdict(session),
            "runs": [{"fitness": float(f), "tree": t} for f, t in zip(self.fitnesses, self.lines, strict=True)],
        }
