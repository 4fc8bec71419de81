"""A domain of its own for the search: blocks with numbered places, each of which may be moved only once the one below it is
in its place. Plain Python, without boxes or physics."""

from __future__ import annotations

import dataclasses
import functools

import jax
import numpy as np

from bt_jax.behaviors import Kind, Symbol, Vocabulary
from bt_jax.encoding.arrays import Trees, decode
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.status import Status
from bt_jax.encoding.tick import NOTED
from bt_jax.encoding.walk import prefix
from bt_jax.gp.achievements.goals import Goals, Measured

MAX_TICKS = 20


@dataclasses.dataclass(frozen=True)
class Tower:
    """`right[b]` is where block b belongs; `near` are a block, a place that will do for it, and by how much fitness falls.
    With a `step`, all blocks are locked until `unlock` has run and `unlocked` was ticked."""

    right: tuple[int, ...] = (4, 1, 3)
    places: int = 6
    step: bool = False
    near: tuple[tuple[int, int, float], ...] = ()

    def misses(self, block: int, place: int) -> float:
        """Return what a block in a place costs."""
        costs = {(b, p): cost for b, p, cost in self.near}
        return 0.0 if place == self.right[block] else costs.get((block, place), 100.0)

    @functools.cached_property
    def vocabulary(self) -> Vocabulary[Symbol]:
        conditions = [Symbol("unlocked", Kind.CONDITION)] if self.step else [Symbol("idle", Kind.CONDITION)]
        actions = [Symbol("unlock", Kind.ACTION)]
        genes = [Symbol(f"{b}@{p}", Kind.GENE) for b in range(len(self.right)) for p in range(self.places)]
        return Vocabulary.of([*conditions, *actions, *genes])

    @functools.cached_property
    def goals(self) -> Goals:
        vocabulary, blocks = self.vocabulary, list(range(len(self.right)))
        groups = {
            Kind.CONDITION: lambda _: -1,
            Kind.ACTION: lambda _: len(blocks),
            Kind.GENE: lambda name: int(name[0]),
        }
        group = [-1] * 3 + [groups[leaf.kind](leaf.name) for leaf in vocabulary.leaves]
        guard = [vocabulary.token(Symbol("unlocked", Kind.CONDITION))] if self.step else []
        return Goals(
            np.array(group, np.int32),
            np.array(blocks + [-1] * self.step, np.int32),
            np.array([0] * len(blocks) + guard, np.int32),
            node_cost=1.0,
        )

    def measured(self, trees: Trees) -> Measured:
        """Return the episodes of trees [R, P, N]."""
        shape = trees.tokens.shape[:2]
        flat = jax.tree.map(lambda leaf: np.asarray(leaf).reshape(-1, leaf.shape[-1]), trees)
        found = [self.episode(flat[i]) for i in range(len(flat.tokens))]
        fitness, solved, achieved, missed, trace = (np.stack(column) for column in zip(*found, strict=True))
        return Measured(
            fitness.astype(np.float32).reshape(shape),
            solved.astype(np.float32).reshape(shape),
            achieved.astype(np.float32).reshape(*shape, -1),
            missed.astype(np.float32).reshape(*shape, -1),
            trace.reshape(*shape, -1),
        )

    def episode(self, tree: Trees) -> tuple[float, bool, np.ndarray, np.ndarray, np.ndarray]:
        """Return fitness, whether the tree solves the task, what was achieved and what was missed, and the trace."""
        root, trace = decode(tree, self.vocabulary), np.zeros(tree.num_nodes, np.uint8)
        nodes, site, successes = prefix(root), Site(self), 0
        for _ in range(MAX_TICKS):
            site.command = None
            ticked = tick_tree(root, site.status_of)
            for node, returned in enumerate(ticked.statuses):
                if returned is not None and isinstance(nodes[node], Symbol):
                    noted = nodes[node].name == "unlocked" and returned == Status.SUCCESS
                    trace[node] |= 1 << returned | NOTED * noted
            successes = successes + 1 if ticked.status == Status.SUCCESS else 0
            if ticked.status == Status.FAILURE or successes == 2:
                break
            site.act()
        missed = np.array(
            [self.misses(b, place) for b, place in enumerate(site.at)] + [100.0 - 100 * site.told] * self.step
        )
        met = missed < 100
        solved = met.all() and ticked.status == Status.SUCCESS
        fitness = -missed.sum() - 20.0 * (ticked.status != Status.SUCCESS) - len(nodes)
        return fitness, solved, met, missed, trace


class Site:
    """A tower while it is built."""

    def __init__(self, tower: Tower) -> None:
        self.tower, self.at = tower, [-1] * len(tower.right)
        self.unlocked = self.told = not tower.step
        self.command: str | None = None

    def status_of(self, leaf: Symbol, _: int) -> Status:
        if leaf.kind == Kind.CONDITION:
            unlocked = leaf.name == "unlocked" and self.unlocked
            self.told = self.told or unlocked
            return Status.SUCCESS if unlocked else Status.FAILURE
        if leaf.name == "unlock":
            done, possible = self.unlocked, True
        else:
            block, place = map(int, leaf.name.split("@"))
            done = self.at[block] == place
            possible = self.told and (block == 0 or self.tower.misses(block - 1, self.at[block - 1]) < 100)
        if done or not possible:
            return Status.SUCCESS if done else Status.FAILURE
        self.command = leaf.name
        return Status.RUNNING

    def act(self) -> None:
        """Carry out what is running."""
        if self.command == "unlock":
            self.unlocked = True
        elif self.command is not None:
            block, place = map(int, self.command.split("@"))
            self.at[block] = place
