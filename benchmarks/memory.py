"""What fits? Memory and time of a generation by population, layouts and nodes, each in a process of its own."""

from __future__ import annotations

import dataclasses
import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter

import tyro

from benchmarks._report import report

SIZES = (
    (16, 1, 64),
    (1_000, 1, 64),
    (10_000, 1, 64),
    (10_000, 10, 64),
    (10_000, 1, 250),
    (100_000, 1, 64),
    (100_000, 10, 64),
)


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Peak memory of the process and seconds a generation, experiment 1a at the physics level."""

    generations: int = 3
    """generations to evolve; the first is not timed, since it compiles"""
    one: tuple[int, int, int] | None = None
    """only measure this population, layouts and nodes, and print JSON"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    if arguments.one is not None:
        print(json.dumps(measure(*arguments.one, arguments.generations)))
        return
    rows = []
    for size in SIZES:
        words = ["--generations", str(arguments.generations), "--one", *map(str, size)]
        done = subprocess.run([sys.executable, __file__, *words], capture_output=True, text=True, check=False)
        measured = json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {}
        rows.append(
            {
                **dict(zip(("population", "layouts", "nodes"), size, strict=True)),
                "s/generation": measured.get("seconds", float("nan")),
                "episodes/s": measured.get("rate", float("nan")),
                "peak memory [MB]": measured.get("megabytes", float("nan")),
            }
        )
    report("memory", "memory and time of a generation", rows, out=arguments.out)


def measure(population: int, layouts: int, nodes: int, generations: int) -> dict[str, float]:
    """Evolves and returns seconds a generation, episodes/s and the peak memory of this process."""
    from bt_jax._util.startup import configure_jax
    from bt_jax.gp.config import GPConfig
    from bt_jax.tasks import load_task
    from bt_jax.training.settings import Settings
    from bt_jax.training.training import Training

    configure_jax()
    config = GPConfig(population=population, generations=generations, max_nodes=nodes)
    states = Training(load_task("stack"), config, Settings(layouts=layouts)).evolution.run()
    next(states), next(states)
    began = perf_counter()
    for _ in range(generations - 1):
        next(states)
    seconds = (perf_counter() - began) / (generations - 1)
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"seconds": seconds, "rate": config.num_offspring * layouts / seconds, "megabytes": megabytes}


if __name__ == "__main__":
    main(tyro.cli(Arguments))
