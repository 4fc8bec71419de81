"""How much faster is the jitted tick than py_trees? The same random trees with the same random leaf statuses.

Both are prepared before they are ticked: py_trees builds its objects, bt_jax its jump tables. A tree is ticked up to 15
times in each layout, so the main ratio is that of ticks alone; the other one counts both preparations and a single tick.

With `--decorators` it measures instead what the state of retry and timeout costs: the same trees as jump tables without
state, in the walk that counts, and with decorators around some of their subtrees.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from pathlib import Path
from time import perf_counter
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import tyro

from benchmarks._report import best_seconds, report
from bt_jax.behaviors import Control, Decorator, ExtendedNode, Kind, Tree, gene_pool
from bt_jax.encoding.arrays import Trees, decode, encode_all
from bt_jax.encoding.formats.py_trees import to_py_trees
from bt_jax.encoding.tick import JumpTable, Status, counters, jump_table, tick_trees
from bt_jax.encoding.walk import decorators
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
    decorators: bool = False
    """measure what decorators cost instead"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    if arguments.decorators:
        report("ticks_decorators", "one tick without and with state", _costs(arguments), out=arguments.out)
        return
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


def _costs(arguments: Arguments) -> list[dict[str, float]]:
    """Measure ticks of `sample` trees, repeated, in the three ways; times are the best of some that take turns."""
    vocabulary = gene_pool(load_task("stack")).extended((), DECORATORS)
    count, rng, rows = arguments.trees, np.random.default_rng(0), []
    which = jnp.arange(count, dtype=jnp.int32) % arguments.sample
    for nodes in arguments.nodes:
        key = jax.random.key(0)
        plain = random_trees(key, Alphabet.of(vocabulary), count=arguments.sample, num_nodes=64, nodes=nodes)
        trees = [decode(plain[row], vocabulary) for row in range(arguments.sample)]
        wrapped = [_decorated(tree, rng) for tree in trees]
        decorated = encode_all(wrapped, vocabulary, 64)
        statuses = jnp.asarray(rng.integers(0, 3, (count, len(vocabulary)), dtype=np.int8))
        counting = counters(vocabulary)
        tables = [jump_table(plain), jump_table(plain, counting), jump_table(decorated, counting)]
        counts = jnp.asarray(rng.integers(0, 2, (count, 64), dtype=np.uint8))
        walks = [functools.partial(jax.jit(_repeated), table, statuses, which, counts) for table in tables]
        for walk in walks:
            jax.block_until_ready(walk())
        best = [math.inf] * len(walks)
        for _ in range(10):
            best = [min(known, best_seconds(walk, repeat=2)) for known, walk in zip(best, walks, strict=True)]
        rows.append(
            {
                "nodes": nodes,
                "decorators": float(np.mean([len(decorators(tree)) for tree in wrapped])),
                "ticks/s": count / best[0],
                "ticks/s, counting": count / best[1],
                "ticks/s, decorators": count / best[2],
                "ratio, counting": best[1] / best[0],
                "ratio, decorators": best[2] / best[0],
            }
        )
    return rows


DECORATORS = tuple(Decorator(kind, number) for kind in (Kind.RETRY, Kind.TIMEOUT) for number in (2, 3, 5))


def _decorated(tree: Tree, rng: np.random.Generator) -> Tree:
    """Return a tree with decorators around a third of its control nodes, actions and genes."""
    if isinstance(tree, Control):
        tree = Control(tree.kind, tuple(_decorated(child, rng) for child in tree.children))
    if rng.random() > 1 / 3 or tree.kind == Kind.CONDITION:
        return tree
    one = DECORATORS[rng.integers(len(DECORATORS))]
    return ExtendedNode(one.kind.name.lower(), (tree,), one.number)


def _repeated(
    table: JumpTable, statuses: jax.Array, which: jax.Array, counts: jax.Array
) -> tuple[jax.Array, jax.Array | None]:
    """Tick trees `which`; return what they return, and the counts for the next tick if the walk counts."""

    def one_block(rows):
        own = None if table.counting is None else counts[rows]
        ticked = tick_trees(table, lambda token: statuses[rows, token], tree=which[rows], counts=own)
        return ticked.status, ticked.counts

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
