"""Where does the time of one run of `train TASK` go?"""

from __future__ import annotations

import cProfile
import dataclasses
import pstats
from pathlib import Path

import tyro

from benchmarks._kits import named
from benchmarks._report import report
from bt_jax._util.startup import CompileClock, configure_jax
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import State
from bt_jax.tasks import Task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Profile a run with the defaults of `train`, after one with another seed that compiles what both need."""

    task: str = "kit12"
    """task of the package, YAML file, tower-of-N or kit-of-N"""
    seed: int = 8200
    """seed of the run that is profiled"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    configure_jax()
    task = named(arguments.task)
    _evolved(task, arguments.seed + 1)
    with cProfile.Profile() as profile, CompileClock() as clock:
        state = _evolved(task, arguments.seed)
    parts, total = _parts(pstats.Stats(profile)), _seconds(pstats.Stats(profile), "run_profile.py", "_evolved")
    rows = [{"part": part, "seconds": round(seconds, 2), "share": seconds / total} for part, seconds in parts.items()]
    title = f"{task.name}, seed {arguments.seed}, {state.trees_measured[0]} episodes"
    report("run_profile", title, rows, out=arguments.out, run=title, compiling=round(clock.seconds, 2))


def _evolved(task: Task, seed: int) -> State:
    *_, state = Training(task, GPConfig(seed=seed), Settings()).evolution.run()
    return state


def _parts(stats: pstats.Stats) -> dict[str, float]:
    """Return the seconds that each part of a run takes."""
    whole = _seconds(stats, "run_profile.py", "_evolved")
    episodes = _seconds(stats, "evaluator.py", "__call__")
    table = sum(_seconds(stats, "table.py", name) for name in ("learn", "complete"))
    simulation = _seconds(stats, "settler.py", "settle")
    leaves = _seconds(stats, "table.py", "_coded")
    breeding, learning = (_seconds(stats, "search.py", name) for name in ("ask", "tell"))
    return {
        "simulation": simulation,
        "what leaves return in new states": leaves,
        "the rest of the table: actions, states, targets": table - simulation - leaves,
        "walks through the table": episodes - table,
        "breeding": breeding,
        "what is learnt from episodes": learning,
        "all else: scene, vocabulary, layouts": whole - episodes - breeding - learning,
    }


def _seconds(stats: pstats.Stats, file: str, function: str) -> float:
    """Return the time spent in a function, what it calls included."""
    entries = stats.stats.items()  # type: ignore[attr-defined]  # not in the stubs
    return sum(entry[3] for (path, _, name), entry in entries if Path(path).name == file and name == function)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
