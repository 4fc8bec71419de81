"""How much faster is the jitted tick than py_trees? The same random trees with the same random leaf statuses.

Both are prepared before they are ticked: py_trees builds its objects, bt_jax its jump tables. A tree is ticked up to 15
times in each layout, so the main ratio is that of ticks alone; the other one counts both preparations and a single tick.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks._report import best_seconds, report
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import Trees, decode
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.tick import JumpTable, Status, jump_table, tick_trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.tasks import load_task

BLOCK = 2000  # trees ticked together: a core's cache holds their tables, and a block ends with its own longest tick


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Ticks per second of whole populations, against py_trees."""

    trees: int = 100_000
    """number of trees, a multiple of 2,000"""
    nodes: tuple[int, ...] = (4, 12, 30)
    """sizes of the trees"""
    sample: int = 2_000
    """trees that py_trees ticks; its time is scaled up"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    vocabulary = gene_pool(load_task("stack"))
    rng = np.random.default_rng(0)
    rows = []
    for nodes in arguments.nodes:
        trees = random_trees(
            jax.random.key(0), Alphabet.of(vocabulary), count=arguments.trees, num_nodes=64, nodes=nodes
        )
        statuses = jnp.asarray(rng.integers(0, 3, (arguments.trees, len(vocabulary)), dtype=np.int8))
        prepare, walk = jax.jit(_tables), jax.jit(_walk)
        table = prepare(trees)
        began = perf_counter()
        status = jax.block_until_ready(walk(table, statuses))
        compile_seconds = perf_counter() - began
        build = best_seconds(functools.partial(prepare, trees))
        ticks = best_seconds(functools.partial(walk, table, statuses), repeat=20)
        seconds, expected = _py_trees(trees[: arguments.sample], statuses[: arguments.sample], vocabulary)
        objects, reference = (s * arguments.trees / arguments.sample for s in seconds)
        assert (np.asarray(status[: arguments.sample]) == expected).all()
        rows.append(
            {
                "nodes": nodes,
                "py_trees [s]": reference,
                "py_trees, objects [s]": objects,
                "tables [s]": build,
                "tick [s]": ticks,
                "compile [s]": compile_seconds,
                "ratio": reference / ticks,
                "ratio, preparation and one tick": (objects + reference) / (build + ticks),
                "ticks/s": arguments.trees / ticks,
            }
        )
    report("ticks", f"one tick of {arguments.trees:,} trees", rows, out=arguments.out)


def _tables(trees: Trees) -> JumpTable:
    return _in_blocks(lambda rows: jump_table(trees[rows]), trees.tokens.shape[0])


def _walk(table: JumpTable, statuses: jax.Array) -> jax.Array:
    def one_block(rows):
        return tick_trees(table, lambda token: statuses[rows, token], tree=rows).status

    return _in_blocks(one_block, statuses.shape[0])


def _in_blocks(function: Callable, count: int) -> Any:
    """What a function of rows gives for `count` rows, one block after the other."""
    results = jax.lax.map(function, jnp.arange(count, dtype=jnp.int32).reshape(-1, BLOCK))
    return jax.tree.map(lambda x: x.reshape(count, *x.shape[2:]), results)


def _py_trees(trees: Trees, statuses: jax.Array, vocabulary) -> tuple[tuple[float, float], np.ndarray]:
    """Seconds that py_trees needs to build the objects of all trees and to tick each once, and what they return."""
    from py_trees.common import Status as PyStatus

    names = {Status.SUCCESS: PyStatus.SUCCESS, Status.FAILURE: PyStatus.FAILURE, Status.RUNNING: PyStatus.RUNNING}
    numbers = {name: number for number, name in names.items()}
    statuses, trees = np.asarray(statuses), jax.device_get(trees)
    decoded, values = [], []
    for row in range(trees.tokens.shape[0]):
        decoded.append(decode(trees[row], vocabulary))
        values.append({leaf: names[int(statuses[row, vocabulary.token(leaf)])] for leaf in vocabulary.leaves})
    began = perf_counter()
    built = [to_py_trees(tree, value.__getitem__) for tree, value in zip(decoded, values, strict=True)]
    objects = perf_counter() - began
    ticks = best_seconds(lambda: [tree.tick_once() for tree in built])
    return (objects, ticks), np.array([numbers[tree.status] for tree in built])


if __name__ == "__main__":
    main(tyro.cli(Arguments))
