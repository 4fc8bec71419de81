"""What a training shows in the terminal while it runs, and at its end."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.panel import Panel
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.text import Text

from bt_jax.encoding.drawing.terminal import draw_text
from bt_jax.encoding.walk import prefix
from bt_jax.gp.evolution import Generation, State
from bt_jax.training.training import Result, Training

__all__ = ["Session", "TrainingDisplay"]

LINES = 10  # printed instead of the live display where there is no terminal


@dataclasses.dataclass(frozen=True)
class Session:
    """What one process did; a resumed run has several."""

    seconds: float  # of evolution
    compile_seconds: float  # of these
    broken: int  # how often physics gave no number
    stopped: bool  # by the user


class TrainingDisplay:
    """Progress of a training; `last` is the latest complete state with its history."""

    def __init__(self, training: Training, folder: Path) -> None:
        self.training, self.folder = training, folder
        self.last: tuple[State | None, list[Generation]] = (None, [])
        self.console = Console(highlight=False)
        self._began = self._first_episode = 0
        self._progress = Progress(
            TextColumn("generation"),
            MofNCompleteColumn(),
            BarColumn(bar_width=None),
            TextColumn("best [bold]{task.fields[best]:.1f}[/]  mean {task.fields[mean]:.1f}"),
            TextColumn("{task.fields[rate]:,.0f} episodes/s"),
            TimeRemainingColumn(compact=True),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )

    def __enter__(self) -> TrainingDisplay:
        training = self.training
        self.console.print(
            f"[bold]{escape(training.task.title)}[/]\n"
            f"population {training.config.population}, {training.config.generations} generations, "
            f"{len(training.vocabulary.leaves)} behaviors; {training.level.name}: {training.level.why}"
        )
        self._bar = self._progress.add_task(
            "", total=training.config.generations, best=float("nan"), mean=float("nan"), rate=0.0
        )
        self._progress.start()
        self._began = time.monotonic()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def update(self, state: State, history: list[Generation]) -> None:
        """Shows a generation; `history` ends with its rows, one for each run."""
        fresh = self.last[0] is None
        self.last = (state, history)
        rows = history[-self.training.config.runs :]
        episodes = sum(row.episodes for row in rows)
        if fresh:
            self._first_episode = episodes
        rate = (episodes - self._first_episode) / max(time.monotonic() - self._began, 1e-9)
        best, mean = max(row.best for row in rows), sum(row.mean for row in rows) / len(rows)
        self._progress.update(self._bar, completed=state.generation, best=best, mean=mean, rate=rate)
        every = max(1, self.training.config.generations // LINES)
        if not self.console.is_terminal and state.generation % every == 0:
            self.console.print(f"generation {state.generation:4d}  best {best:9.1f}  mean {mean:9.1f}  {rate:8,.0f} /s")

    def finish(self, result: Result, state: State, session: Session) -> None:
        """The learnt tree and what there is to know of it."""
        episodes = sum(state.trees_measured) * self.training.settings.layouts
        self.console.print(Panel(Text(draw_text(result.tree).rstrip()), title="learnt tree", title_align="left"))
        if session.stopped:
            self.console.print(
                f"stopped after generation {state.generation}; go on with --resume {escape(str(self.folder))}"
            )
        success = result.test.success_rate * len(result.test.solved)
        self.console.print(
            f"fitness      [bold]{result.fitness:.1f}[/]\n"
            f"success      [bold]{success:.0f} of {len(result.test.solved)}[/] unseen layouts, "
            f"fitness there {result.test.fitness.mean():.1f} ± {result.test.fitness.std():.1f}\n"
            f"evolution    {state.generation} generations, {episodes:,} episodes; this session "
            f"{session.seconds:.1f} s, {session.compile_seconds:.1f} s of it compiling\n"
            f"{self._simulated()}"
            f"results      {escape(str(self.folder))}",
            soft_wrap=True,
        )
        if len(prefix(result.tree)) > 1 + len(self.training.task.targets):
            self.console.print(
                f"simplify     python -m bt_jax.run {escape(str(self.folder))} --simplify", soft_wrap=True
            )
        if session.broken:
            self.console.print(
                f"warning: physics gave no number {session.broken} times; the trees that met it got the worst fitness"
            )

    def _simulated(self) -> str:
        if self.training.settings.evaluator != "table":
            return ""
        table = self.training.table
        return f"simulation   {table.num_transitions:,} distinct transitions, {table.settler.solved:,} new to physics\n"
