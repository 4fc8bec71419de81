"""python -m bt_jax.deploy rates LOG...: how often what goes wrong, from the logs of runs, for `train --faults`."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import chi2

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax._util.statistics import wilson
from bt_jax._util.words import counted
from bt_jax.deploy.commands.arguments import RatesArguments
from bt_jax.deploy.execution.fault_counts import FaultCounts, count_faults
from bt_jax.deploy.execution.log_reader import Damage, numbered_entries
from bt_jax.deploy.execution.recorded import program_of

__all__ = ["Estimate", "estimates", "rates_command"]

COVERED = 0.95


@dataclasses.dataclass(frozen=True)
class Estimate:
    """The value of a key of `Faults`, the interval that covers it with 95 %, and what it is from, in words."""

    key: str
    value: float
    low: float
    high: float
    source: str


def rates_command(arguments: RatesArguments, console: Console | None = None) -> int:
    """Print the rates that the logs tell, and write them as a file of faults; return the exit code."""
    console = Console(highlight=False, soft_wrap=True) if console is None else console
    arguments.check()
    counts, paths = FaultCounts(), log_paths(arguments.logs)
    for path in paths:
        damage = Damage(path, strict=False)
        entries = [entry for _, entry in numbered_entries(path, damage)]
        try:
            counts += count_faults(program_of(entries[0], path).task, entries)
        except (KeyError, ValueError, TypeError) as error:
            raise UserError(f"{path} is no whole log ({error}); leave it out") from error
        except UserError as error:
            raise UserError(f"{path}: {error}") from error
        if damage.lines:
            console.print(f"damaged    {path}, line {damage}: left out", markup=False, style="red")
    if not counts.attempts:
        raise UserError("no attempt was carried out in these logs; give logs of runs that moved the robot or its twin")
    found = estimates(counts)
    console.print(_table(found))
    console.print(_remarks(counts, len(paths)))
    if arguments.out is not None:
        write_atomic(arguments.out, as_yaml(found, counts, len(paths)))
        console.print(f"faults     {arguments.out}, for train, run and twin --faults", markup=False)
    return 0


def log_paths(given: Sequence[Path]) -> list[Path]:
    """Return the logs that are given, and those in the folders. Raise UserError for a folder without any."""
    found: list[Path] = []
    for path in given:
        own = sorted(path.glob("*.jsonl")) if path.is_dir() else [path]
        if not own:
            raise UserError(f"the folder {path} has no log (.jsonl); give the logs that twin or run has written")
        found += own
    return list(dict.fromkeys(found))


def estimates(counts: FaultCounts) -> list[Estimate]:
    """Return what was counted as the keys of `Faults`: shares of attempts and of ticks, and spreads about 0."""
    attempts, picks, places, ticks = counts.attempts, counts.picks, counts.places, counts.ticks
    along = [value for error in counts.errors for value in error]
    slip, drop = _share("slip", counts.slips, picks, "picks"), _share("drop", counts.drops, places, "places")
    jam = _share("jam", counts.jams, attempts, "attempts")
    # Each attempt ends in one way, also with shares of few attempts and as they are written.
    most = math.floor(1000 * (1 - max(float(_number(one.value)) for one in (slip, drop)))) / 1000
    return [
        slip,
        drop,
        dataclasses.replace(jam, value=min(jam.value, most)),
        _spread("place_spread", along, counted(len(counts.errors), "place")),
        _spread("turn_spread", list(counts.turns), counted(len(counts.turns), "place")),
        _share("hide", len(counts.hidden), ticks, "ticks"),
        _share("move", counts.moved, ticks, "ticks"),
        _share("take", len(counts.taken), ticks, "ticks"),
    ]


def _share(key: str, count: int, tries: int, noun: str) -> Estimate:
    low, high = wilson(min(count, tries), tries)
    return Estimate(key, min(count, tries) / max(tries, 1), low, high, f"{count} of {tries} {noun}")


def _spread(key: str, values: Sequence[float], source: str) -> Estimate:
    """Return the root mean square of values, whose sum of squares has a chi-squared distribution if they are Gaussian."""
    if not values:
        return Estimate(key, 0.0, 0.0, math.inf, source)
    squares, tail = float(np.square(values).sum()), (1 - COVERED) / 2
    low, high = (math.sqrt(squares / chi2.ppf(1 - share, len(values))) for share in (tail, 1 - tail))
    return Estimate(key, math.sqrt(squares / len(values)), low, high, source)


def _lengths(counts: FaultCounts) -> dict[str, int]:
    """Return for how many ticks objects were out of sight, of those keys for which any was."""
    times = {"hide_ticks": counts.hidden, "take_ticks": counts.taken}
    return {key: max(1, round(float(np.mean(each)) / counts.tick)) for key, each in times.items() if each}


def as_yaml(found: Sequence[Estimate], counts: FaultCounts, logs: int) -> str:
    """Return the file of faults: each key with what it is from."""
    lines = [f"# from {counted(logs, 'log')} of deploy; a tick stands for {counts.tick:.1f} s"]
    lines += [f"{e.key}: {_number(e.value)}  # {_interval(e)}; {e.source}" for e in found]
    lines += [f"{key}: {value}" for key, value in _lengths(counts).items()]
    return "\n".join(lines) + "\n"


def _table(found: Sequence[Estimate]) -> Table:
    table = Table(box=None, pad_edge=False)
    for column in ("fault", "rate", "95 % interval", "from"):
        table.add_column(column, justify="left" if column in ("fault", "from") else "right")
    for estimate in found:
        table.add_row(
            estimate.key, _number(estimate.value), _interval(estimate).removeprefix("95 %: "), estimate.source
        )
    return table


def _remarks(counts: FaultCounts, logs: int) -> str:
    lines = [
        f"logs       {logs}; a tick stands for {counts.tick:.1f} s, an attempt with what the camera then has to see"
    ]
    if counts.strays:
        lines.append(f"left out   {counted(counts.strays, 'object')} that did not stay near the place")
    lines.append("unknown    heavy: what is heavier or more slippery counts as slip and drop")
    return "\n".join(lines)


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _interval(estimate: Estimate) -> str:
    return f"95 %: {_number(estimate.low)} to {_number(estimate.high)}"
