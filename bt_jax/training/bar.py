"""The progress of an evolution on a console: a bar on a terminal, a few lines in a notebook or a file."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from bt_jax.gp.evolution import Generation

__all__ = ["GenerationBar", "is_interactive"]

LINES = 10  # printed instead of a bar if this is not a terminal


def is_interactive() -> bool:
    """Return whether a person types the program in, at a prompt or in a notebook."""
    return hasattr(sys, "ps1")


class GenerationBar:
    """Shows generations from `start` to `stop`, or as a context. `by_chance`: episodes differ by chance, so that the share
    of them that the best tree solves is worth showing."""

    def __init__(self, console: Console, generations: int, *, by_chance: bool = False) -> None:
        self._console, self._generations, self._by_chance = console, generations, by_chance
        self._began, self._first_episode = time.monotonic(), -1
        self._shown = -1  # the last generation
        self._progress = Progress(
            TextColumn("generation"),
            MofNCompleteColumn(),
            BarColumn(bar_width=None),
            TextColumn("best [bold]{task.fields[best]:.1f}[/]  mean {task.fields[mean]:.1f}{task.fields[solves]}"),
            TextColumn("{task.fields[rate]:,.0f} episodes/s"),
            TimeRemainingColumn(compact=True),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        nothing = float("nan")
        self._bar = self._progress.add_task("", total=generations, best=nothing, mean=nothing, solves="", rate=0.0)

    def start(self) -> None:
        """Draw the bar."""
        self._progress.start()

    def stop(self) -> None:
        """Remove the bar."""
        self._progress.stop()

    def __enter__(self) -> GenerationBar:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def update(self, rows: Sequence[Generation]) -> None:
        """Show a generation, of which there is one row for each run."""
        episodes, generation = sum(row.episodes for row in rows), rows[0].generation
        if self._first_episode < 0:
            self._began, self._first_episode = time.monotonic(), episodes
        rate = (episodes - self._first_episode) / max(time.monotonic() - self._began, 1e-9)
        best, mean = max(row.best for row in rows), sum(row.mean for row in rows) / len(rows)
        success = max(rows, key=lambda row: row.best).success
        solves = f"  solves {100 * success:3.0f} %" if self._by_chance else ""
        self._progress.update(self._bar, completed=generation, best=best, mean=mean, solves=solves, rate=rate)
        every = max(1, self._generations // LINES)
        if not self._console.is_terminal and generation % every == 0 and generation != self._shown:
            self._console.print(
                f"generation {generation:4d}  best {best:9.1f}  mean {mean:9.1f}{solves}  {rate:8,.0f} episodes/s"
            )
        self._shown = generation
