"""What fits? Memory and time of a generation, each in a process of its own, and memory of one state of the table."""

from __future__ import annotations

import dataclasses
import itertools
import json
import resource
import subprocess
import sys
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import jax
import numpy as np
import tyro

from benchmarks._report import report
from bt_jax._util.startup import configure_jax
from bt_jax.behaviors import FIRST_LEAF, gene_pool
from bt_jax.gp.config import GPConfig
from bt_jax.mjx_env.episodes.table import TableFullError, TransitionTable
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.tasks import load_task
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
LARGEST = str(Path(__file__).parent / "tasks/largest.yaml")  # 16 objects in four trays
LONG = 30  # generations
AT_A_TIME = 4096  # states that are entered at a time


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Peak memory of the process and seconds a generation, experiment 1a at the physics level."""

    generations: int = 3
    """generations to evolve; the first is not timed, since it compiles"""
    one: tuple[int, int, int] | None = None
    """only measure this population, layouts and nodes, and print JSON"""
    filled: float | None = None
    """only fill a table of that many GB with states of 16 objects in four trays, and print JSON"""
    trained: bool = False
    """only evolve for 16 objects in four trays with the default settings for as many generations, and print JSON"""
    parts: tuple[Literal["generations", "states", "largest"], ...] = ("generations", "states", "largest")
    """what to measure"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    if arguments.one is not None:
        print(json.dumps(measure(*arguments.one, arguments.generations)))
        return
    if arguments.filled is not None:
        print(json.dumps(filled(arguments.filled)))
        return
    if arguments.trained:
        print(json.dumps(trained(arguments.generations)))
        return
    if "generations" in arguments.parts:
        generations(arguments)
    if "states" in arguments.parts:
        report("memory_states", "memory of one state of the transition table", states())
    if "largest" in arguments.parts:
        report("memory_largest", "16 objects in four trays", largest())


def generations(arguments: Arguments) -> None:
    """Measures each size in a process of its own."""
    rows = []
    for size in SIZES:
        measured = _apart("--generations", arguments.generations, "--one", *size)
        rows.append(
            {
                **dict(zip(("population", "layouts", "nodes"), size, strict=True)),
                "s/generation": measured.get("seconds", float("nan")),
                "episodes/s": measured.get("rate", float("nan")),
                "peak memory [MB]": measured.get("megabytes", float("nan")),
            }
        )
    report("memory", "memory and time of a generation", rows, out=arguments.out)


def largest() -> list[dict[str, Any]]:
    """What the largest task takes: an evolution with the default settings, and tables filled until they begin again."""
    rows = [
        {
            "what": f"train, {LONG} generations",
            "memory [GB]": Settings().memory,
            **_apart("--trained", "--generations", LONG),
        }
    ]
    for memory in (1, 4):
        rows.append({"what": "a full table", "memory [GB]": memory, **_apart("--filled", memory)})
    return rows


def trained(generations: int) -> dict[str, float]:
    """Evolves for the largest task and returns what the table holds and the peak memory of this process."""
    configure_jax()
    training = Training(load_task(LARGEST), GPConfig(generations=generations), Settings())
    most = 0
    for _ in training.evolution.run():
        most = max(most, training.table.nbytes)
    return _held(training.table, training.table.num_states, most)


def filled(memory: float) -> dict[str, float]:
    """Enters states of the largest task, of which two leaves are asked, until the table is full."""
    configure_jax()
    task = load_task(LARGEST)
    semantics = LeafSemantics(task, gene_pool(task))
    table = TransitionTable(semantics, Kinematic(task), memory=int(memory * (1 << 30)))
    table.use(np.arange(FIRST_LEAF, FIRST_LEAF + 2))
    one, most, held = sample_layouts(task, 0, 1), 0, 0
    moved = np.float32(1e-4) * np.arange(AT_A_TIME, dtype=np.float32)
    try:
        for part in itertools.count():
            worlds = jax.tree.map(lambda leaf: np.repeat(leaf, AT_A_TIME, axis=0), one)
            poses = worlds.poses.copy()
            poses[:, 0, 0] += moved
            poses[:, 1, 0] += np.float32(1e-4 * part)
            states = table.ids(dataclasses.replace(worlds, poses=poses))
            table.learn(states, np.zeros(AT_A_TIME, np.int32))  # which leads to the same state
            most, held = max(most, table.nbytes), table.num_states
    except TableFullError:
        pass
    return _held(table, held, most)


def _held(table: TransitionTable, states: int, most: int) -> dict[str, float]:
    """Returns a row: what a table holds at most, and the peak memory of this process."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "states": states,
        "began again": table.num_restarts,
        "table [MB]": most / (1 << 20),
        "peak memory [MB]": peak,
    }


def _apart(*words: object) -> dict[str, Any]:
    """Returns what this file prints in a process of its own with these arguments; nothing if that fails."""
    done = subprocess.run([sys.executable, __file__, *map(str, words)], capture_output=True, text=True, check=False)
    return json.loads(done.stdout.splitlines()[-1]) if done.returncode == 0 else {}


def states() -> list[dict[str, Any]]:
    """Bytes of a state in a full table: of outcomes and transitions, in dense arrays of int32 and as they are kept, and with
    all else that the host keeps of it."""
    rows = []
    for task in (load_task("stack"), load_task("restack"), load_task(LARGEST)):
        semantics = LeafSemantics(task, gene_pool(task))
        table = TransitionTable(semantics, Kinematic(task))
        starts = np.arange(FULL, dtype=np.int32)
        worlds = sample_layouts(task, 0, 1)
        worlds = jax.tree.map(lambda leaf: np.repeat(leaf, FULL, axis=0), worlds)
        table.ids(dataclasses.replace(worlds, kits=worlds.kits + np.float32(1e-4) * starts[:, None, None]))
        table.learn(starts, np.zeros(FULL, np.int32))  # which leads to the same state
        tokens, commands = len(semantics.vocabulary), table.num_columns
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
