"""How much faster is the jitted tick than py_trees? The same random trees with the same random leaf statuses."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from _report import best_seconds, report

from bt_jax.behaviors import gene_pool
from bt_jax.encoding.pytrees import to_py_trees
from bt_jax.encoding.tick import Status, jump_table, tick
from bt_jax.encoding.trees import Trees, decode
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.random_trees import random_trees
from bt_jax.task import load_task


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Ticks per second of whole populations, against py_trees."""

    trees: int = 100_000
    """number of trees"""
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
        table = jax.jit(jump_table)(trees)
        walk = jax.jit(_walk)
        began = perf_counter()
        status = jax.block_until_ready(walk(table, statuses))
        compile_seconds = perf_counter() - began
        build = best_seconds(functools.partial(jax.jit(jump_table), trees))
        ticks = best_seconds(functools.partial(walk, table, statuses))
        reference, expected = _py_trees(trees[: arguments.sample], statuses[: arguments.sample], vocabulary)
        reference *= arguments.trees / arguments.sample
        assert (np.asarray(status[: arguments.sample]) == expected).all()
        rows.append(
            {
                "nodes": nodes,
                "py_trees [s]": reference,
                "tables [s]": build,
                "tick [s]": ticks,
                "compile [s]": compile_seconds,
                "ratio": reference / ticks,
                "ratio, tables built for one tick": reference / (ticks + build),
                "ticks/s": arguments.trees / ticks,
            }
        )
    report("ticks", f"one tick of {arguments.trees:,} trees", rows, out=arguments.out)


def _walk(table, statuses):
    rows = jnp.arange(statuses.shape[0])
    return tick(table, lambda token: statuses[rows, token]).status


def _py_trees(trees: Trees, statuses: jax.Array, vocabulary) -> tuple[float, np.ndarray]:
    """Seconds that py_trees needs to tick all trees once, building them not counted, and what they return."""
    from py_trees.common import Status as PyStatus

    names = {Status.SUCCESS: PyStatus.SUCCESS, Status.FAILURE: PyStatus.FAILURE, Status.RUNNING: PyStatus.RUNNING}
    numbers = {name: number for number, name in names.items()}
    statuses = np.asarray(statuses)
    built = []
    for row in range(trees.tokens.shape[0]):
        values = {leaf: names[int(statuses[row, vocabulary.token(leaf)])] for leaf in vocabulary.leaves}
        built.append(to_py_trees(decode(trees[row], vocabulary), values.__getitem__))
    began = perf_counter()
    for tree in built:
        tree.tick_once()
    return perf_counter() - began, np.array([numbers[tree.status] for tree in built])


if __name__ == "__main__":
    main(tyro.cli(Arguments))
