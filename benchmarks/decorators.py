"""Do trees with decorators tick as in py_trees?

The oracle is py_trees with its own Retry and Timeout. The clock of that Timeout is replaced by one that moves by one in each
tick: `timeout(n)` fails in the n-th tick in a row in which its child is RUNNING, so the clock must be more than n - 2 ahead
of the first of them.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from unittest import mock

import jax
import jax.numpy as jnp
import numpy as np
import tyro
from py_trees import decorators as theirs
from py_trees.behaviour import Behaviour
from py_trees.common import Status as TheirStatus
from py_trees.composites import Selector, Sequence

from benchmarks._report import report
from bt_jax.behaviors import Control, ExtendedNode, Kind, Vocabulary
from bt_jax.behaviors.nodes import Decorator, Node, Symbol
from bt_jax.encoding.arrays import encode_all
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.tick import Status, counters, jump_table, tick_trees
from bt_jax.encoding.walk import prefix

LEAVES = tuple(Symbol(f"leaf{i}", Kind.ACTION) for i in range(6))
DECORATORS = tuple(Decorator(kind, number) for kind in (Kind.RETRY, Kind.TIMEOUT) for number in (1, 2, 3))
VOCABULARY = Vocabulary.of(LEAVES, DECORATORS)
NUM_NODES = 64
BLOCK = 1000  # trees ticked together
NAMES = {status: TheirStatus[status.name] for status in Status}


@dataclasses.dataclass(frozen=True)
class Arguments:
    """Ticks of trees with retry and timeout, against py_trees."""

    trees: int = 10_000
    """number of random trees, a multiple of 1,000"""
    ticks: int = 12
    """ticks of each tree, each with new statuses of the leaves"""
    out: Path | None = None
    """JSON file to write"""


def main(arguments: Arguments) -> None:
    found = compare(arguments.trees, ticks=arguments.ticks, seed=0)
    report("decorators", "trees with retry and timeout against py_trees", [found], out=arguments.out)
    assert found["differences"] == 0


def random_tree(rng: np.random.Generator, num_leaves: int) -> Node[Symbol]:
    """Any tree of control nodes and decorators."""
    if rng.random() < 0.3:
        name = ("retry", "timeout")[rng.integers(2)]
        return ExtendedNode(name, (random_tree(rng, num_leaves),), int(rng.integers(1, 4)))
    if num_leaves == 1:
        return LEAVES[rng.integers(len(LEAVES))]
    parts = int(rng.integers(1, num_leaves + 1))
    cuts = np.sort(rng.choice(num_leaves - 1, parts - 1, replace=False)) + 1
    counts = np.diff([0, *cuts, num_leaves])
    kind = Kind.SEQUENCE if rng.random() < 0.5 else Kind.FALLBACK
    return Control(kind, tuple(random_tree(rng, int(count)) for count in counts))


def compare(count: int, *, ticks: int, seed: int) -> dict[str, int]:
    """Tick random trees with random leaf statuses in compiled code, in plain Python and in py_trees. A difference is a
    tick with another status of the root, other leaves that are ticked, or another leaf that is RUNNING at its end."""
    rng = np.random.default_rng(seed)
    forest: list[Node[Symbol]] = []
    while len(forest) < count:
        tree = random_tree(rng, int(rng.integers(1, 13)))
        if len(prefix(tree)) <= NUM_NODES:
            forest.append(tree)
    shares = rng.dirichlet((1, 1, 1), count)  # some trees meet mostly successes, others mostly failures
    draws = rng.random((ticks, count, len(VOCABULARY), 1))
    statuses = (draws > np.cumsum(shares, axis=1)[None, :, None, :2]).sum(axis=-1).astype(np.int8)
    walked = [_walked(forest[at : at + BLOCK], statuses[:, at : at + BLOCK]) for at in range(0, count, BLOCK)]
    differences = 0
    for row, tree in enumerate(forest):
        compiled = [tick[row % BLOCK] for tick in walked[row // BLOCK]]
        plain, oracle = _plain(tree, statuses[:, row]), _in_py_trees(tree, statuses[:, row])
        differences += sum(not a == b == c for a, b, c in zip(compiled, plain, oracle, strict=True))
    return {"trees": count, "ticks": count * ticks, "differences": differences}


Told = tuple[Status, list[int], int | None]  # of the root, the leaves that were ticked, and the one that is RUNNING


@jax.jit
def _ticked(trees, statuses, counts):
    rows = jnp.arange(statuses.shape[0])
    table = jump_table(trees, counters(VOCABULARY))
    return tick_trees(table, lambda token: statuses[rows, token], trace=True, counts=counts)


def _walked(forest: list[Node[Symbol]], statuses: np.ndarray) -> list[list[Told]]:
    """What compiled code says of each tick of all trees."""
    trees = encode_all(forest, VOCABULARY, NUM_NODES)
    counts, told = np.zeros(trees.tokens.shape, np.uint8), []
    for row in statuses:
        ticked = jax.device_get(_ticked(trees, row, counts))
        counts = ticked.counts
        runs = np.where(ticked.acts, ticked.leaf, -1)
        told.append(
            [
                (Status(status), np.flatnonzero(seen).tolist(), None if leaf < 0 else int(leaf))
                for status, seen, leaf in zip(ticked.status, ticked.visited, runs, strict=True)
            ]
        )
    return told


def _plain(tree: Node[Symbol], statuses: np.ndarray) -> list[Told]:
    """What plain Python says of each tick of a tree."""
    memory, nodes, told = TreeMemory(), prefix(tree), []
    for row in statuses:
        seen: list[int] = []

        def status_of(leaf: Symbol, index: int, row: np.ndarray = row, seen: list[int] = seen) -> Status:
            seen.append(index)
            return Status(row[VOCABULARY.token(leaf)])

        ticked = tick_tree(tree, status_of, memory)
        memory, running = ticked.memory, ticked.running
        acts = running is not None and isinstance(nodes[running], Symbol)
        told.append((ticked.status, seen, running if acts else None))
    return told


class _Leaf(Behaviour):
    """A leaf whose status is set from outside; it writes down that it was ticked."""

    def __init__(self, symbol: Symbol, index: int, seen: list[int]) -> None:
        super().__init__(name=f"{symbol} {index}")
        self.token, self.index, self.seen = VOCABULARY.token(symbol), index, seen
        self.row: np.ndarray = np.zeros(len(VOCABULARY), np.int8)

    def update(self) -> TheirStatus:
        self.seen.append(self.index)
        return NAMES[Status(self.row[self.token])]


def _in_py_trees(tree: Node[Symbol], statuses: np.ndarray) -> list[Told]:
    """What py_trees says of each tick of a tree."""
    seen: list[int] = []
    leaves: list[_Leaf] = []
    count = 0

    def build(node: Node[Symbol]) -> Behaviour:
        nonlocal count
        index, count = count, count + 1
        if isinstance(node, Symbol):
            leaves.append(_Leaf(node, index, seen))
            return leaves[-1]
        below = [build(child) for child in node.children]
        if isinstance(node, Control):
            made = Sequence if node.kind == Kind.SEQUENCE else Selector
            return made(name=str(index), memory=False, children=below)
        assert node.number is not None
        if node.name == "retry":
            return theirs.Retry(name=str(index), child=below[0], num_failures=node.number)
        return theirs.Timeout(name=str(index), child=below[0], duration=node.number - 1.5)

    root, told = build(tree), []
    for tick, row in enumerate(statuses):
        seen.clear()
        for leaf in leaves:
            leaf.row = row
        with mock.patch("py_trees.decorators.time.monotonic", lambda tick=tick: float(tick)):
            root.tick_once()
        running = next((leaf.index for leaf in leaves if leaf.status == TheirStatus.RUNNING), None)
        told.append((Status[root.status.name], list(seen), running))
    return told


if __name__ == "__main__":
    main(tyro.cli(Arguments))
