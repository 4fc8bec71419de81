"""What `python -m bt_jax.experiments` does: the paper's experiments 1 to 3, with demonstration, with GP only and by the
method achievements."""

from __future__ import annotations

import functools
import json
from datetime import datetime
from pathlib import Path
from typing import get_args

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from bt_jax._util.files import unused, write_atomic
from bt_jax._util.startup import configure_jax
from bt_jax.experiments import report
from bt_jax.experiments.arguments import ExperimentsArguments
from bt_jax.experiments.machine import machine
from bt_jax.experiments.protocol import EXPERIMENTS, Variant, VariantResult, perform
from bt_jax.experiments.published import published_curves

__all__ = ["run"]


def run(arguments: ExperimentsArguments) -> None:
    """Run the experiments, print the table and write the report; what is finished stays if a later part is stopped."""
    arguments.check()
    console = Console(highlight=False, soft_wrap=True)
    curves = published_curves()
    configure_jax("cpu")
    chosen = [one for one in EXPERIMENTS if arguments.which in ("all", str(one.number))]
    out = arguments.out or unused(Path("runs") / f"experiments-{datetime.now():%Y%m%d-%H%M%S}")
    results: list[VariantResult] = []
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True,
        disable=not console.is_terminal,
    ) as bars:  # fmt: skip
        for experiment in chosen:
            for variant in get_args(Variant):
                name = f"experiment {experiment.number}, {report.NAMES[variant]}"
                bar = bars.add_task(name, total=experiment.config.num_generations)
                result = perform(
                    experiment,
                    variant,
                    runs=arguments.runs,
                    seed=arguments.seed,
                    test_layouts=arguments.test_layouts,
                    progress=functools.partial(_advance, bars, bar),
                )
                bars.remove_task(bar)
                results.append(result)
                last = result.best[:, -1]
                solved = (last >= experiment.wanted).sum()
                console.print(
                    f"{name}: best fitness {last.mean():.1f} ± {last.std():.1f}, {solved} of {len(last)} runs at "
                    f"{experiment.wanted:g} or better, {result.seconds:.0f} s"
                )
            these = [one for one in results if one.experiment is experiment]
            write_atomic(out / f"experiment_{experiment.number}.png", report.figure(these, curves))
            write_atomic(out / "report.md", report.markdown(results, curves, machine=machine()))
            write_atomic(out / "results.json", json.dumps(_data(results), indent=1) + "\n")
    for experiment in chosen:
        _print(console, report.table([one for one in results if one.experiment is experiment], curves))
    console.print(f"report     {escape(str(out / 'report.md'))}")


def _print(console: Console, rows: list[dict[str, str]]) -> None:
    drawn = Table(title=f"experiment {rows[0]['experiment']}", title_justify="left", show_header=True)
    for column in ("", *(row["variant"] for row in rows)):
        drawn.add_column(column)
    for column in list(rows[0])[2:]:
        drawn.add_row(column, *(row[column] for row in rows))
    console.print(drawn)


def _advance(bars: Progress, bar: TaskID, generation: int) -> None:
    bars.update(bar, completed=generation)


def _data(results: list[VariantResult]) -> list[dict]:
    """Return what the figures were drawn from."""
    return [
        {
            "experiment": result.experiment.number,
            "variant": result.variant,
            "seconds": round(result.seconds, 2),
            "episodes": result.episodes,
            "unseen": result.solved_unseen,
            "best": result.best.round(2).tolist(),
            "trees": list(map(str, result.trees)),
        }
        for result in results
    ]
