"""What fits? Memory and time of a generation, each in a process of its own, and memory of one state of the table."""

from __future__ import annotations

import dataclasses
import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import gene_pool
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.episodes.table import TransitionTable
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import Task, load_task
from bt_jax.training.settings import Settings
from bt_jax.training.training import Training

SIZES = (
    (16, 1, 64),
    (1_000, 1, 64),
    (10_000, 1, 64),
    (10_000, 10, 64),
    (10_000, 1, 250),
    (100_000, 1, 64),
    (100_000, 10, 64),
)

FULL = 1984  # states that fill the table that one begins with


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
    report("memory_states", "memory of one state of the transition table", states())


def states() -> list[dict[str, Any]]:
    """Bytes of a state in a full table: of outcomes and transitions, in dense arrays of int32 and as they are kept, and with
    all else that the host keeps of it."""
    rows = []
    for task in (load_task("stack"), load_task("restack"), _sixteen_objects()):
        semantics = LeafSemantics(task, gene_pool(task))
        table = TransitionTable(semantics, Kinematic(task))
        starts = np.arange(FULL, dtype=np.int32)
        worlds = sample_layouts(task, 0, 1)
        worlds = jax.tree.map(lambda leaf: np.repeat(leaf, FULL, axis=0), worlds)
        table.ids(dataclasses.replace(worlds, kits=worlds.kits + np.float32(1e-4) * starts[:, None, None]))
        table.learn(starts, np.zeros(FULL, np.int32))  # which leads to the same state
        tokens, commands = len(semantics.vocabulary), table.num_commands
        rows.append(
            {
                "task": task.name,
                "objects": len(task.objects),
                "leaves": len(semantics.vocabulary.leaves),
                "commands": commands,
                "dense [B]": 4 * (2 * tokens + commands),
                "kept [B]": sum(leaf.nbytes for leaf in jax.tree.leaves(table.known)) // FULL,
                "with all else [B]": table.nbytes // FULL,
            }
        )
    return rows


def _sixteen_objects() -> Task:
    """Return a task with as many places as 16 objects have: on each other, at four sides of each other, and in 16 slots of
    four trays."""
    task = load_task("stack")
    more = tuple(dataclasses.replace(task.objects[0], name=f"Box{i}") for i in range(3, 16))
    boxes = tuple(dataclasses.replace(box, size=(0.04, 0.04, 0.04)) for box in (*task.objects, *more))
    layout = dataclasses.replace(task.layout, spacing=0.06, margin=0.05)
    genes = dataclasses.replace(task.genes, grid=8, pitch=0.05)
    return dataclasses.replace(task, name="16 objects", objects=boxes, layout=layout, genes=genes)


def measure(population: int, layouts: int, nodes: int, generations: int) -> dict[str, float]:
    """Evolves and returns seconds a generation, episodes/s and the peak memory of this process."""
    configure_jax()
    config = GPConfig(method="population", population=population, generations=generations, max_nodes=nodes)
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
