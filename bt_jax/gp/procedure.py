"""What every procedure that evolves trees shares: its state, the loop over generations, and what is told of them."""

from __future__ import annotations

import abc
import dataclasses
import time
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float32, UInt64

from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.knowledge import Knowledge
from bt_jax.gp.config import GPConfig
from bt_jax.gp.steps import Population, diversity_of, hashes_of, run_keys

__all__ = ["Generation", "Procedure", "State", "best_of", "now_seen", "on_device"]


@dataclasses.dataclass(frozen=True)
class State:
    """Everything that the next generation depends on, and what was measured so far."""

    population: Population
    generation: int
    baseline_fitness: Float32[Array, " R"]  # of the baseline if there is one, else of an individual at the start
    seen: tuple[UInt64[np.ndarray, " _"], ...]  # for each run the hashes of all trees measured, sorted
    earlier: tuple[int, ...]  # for each run, how many were measured before, for another fitness
    knowledge: tuple[Knowledge, ...] = ()  # for each run what an `AchievementSearch` has learnt

    @property
    def trees_measured(self) -> list[int]:
        """How many distinct trees each run has measured."""
        return [before + len(hashes) for before, hashes in zip(self.earlier, self.seen, strict=True)]


@dataclasses.dataclass(frozen=True)
class Generation:
    """One run after one generation. `episodes`: distinct trees measured so far, times the layouts in which each is.

    `baseline_leaves` is how many leaves of the best tree are leaves of the baseline, `baseline_child` the child of the root,
    counted from 0, under which the first of them stands; -1 if there is none. Of an `AchievementSearch`: `kept` trees in its
    archive, the most targets and subgoals `achieved` by one of them, how many are `understood`, so that a leaf is known to
    bring them about or a tree has reached them, and the share of its episodes that the best tree solves, its `success`.
    """

    run: int
    generation: int
    episodes: int
    best: float
    mean: float
    std: float
    nodes: int
    fitness_entropy: float
    edit_distance: float
    baseline_leaves: int
    baseline_child: int
    kept: int = 0
    achieved: int = 0
    understood: int = 0
    success: float = 0.0


class Procedure(abc.ABC):
    """R independent runs, generation after generation. `episodes_per_tree` only serves to count episodes."""

    def __init__(self, config: GPConfig, *, baseline: Trees | None, episodes_per_tree: int) -> None:
        self.config, self.baseline, self.episodes_per_tree = config, baseline, episodes_per_tree
        self.keys = run_keys(np.arange(config.seed, config.seed + config.runs, dtype=np.uint32))

    @abc.abstractmethod
    def step(self, state: State | None) -> State:
        """Return the state one generation later, or for None the first."""

    @abc.abstractmethod
    def adopt(self, trees: Trees, *, generation: int, earlier: Sequence[int]) -> State:
        """Go on with populations [R, P, N] that were bred for another fitness: they are measured again, and the baseline,
        if any, takes the place of the worst. `earlier` is how many trees each run has measured so far."""

    def kept(self, state: State) -> Trees:
        """Return the trees [R, P, N] that a state hands on to another phase."""
        return state.population.trees

    def has_ended(self, state: State) -> bool:
        """Return whether more generations would be of no use."""
        return False

    def run(
        self, state: State | None = None, *, target: float | None = None, time_limit: float | None = None
    ) -> Iterator[State]:
        """Yield the state after each generation, the first or the given one included, until the last generation, until
        every run has reached the `target` fitness, for `time_limit` seconds, or until the procedure is at its end."""
        began = time.monotonic()
        state = self.step(None) if state is None else state
        yield state
        while state.generation < self.config.num_generations:
            if target is not None and np.asarray(state.population.fitness).max(axis=1).min() >= target:
                return
            if time_limit is not None and time.monotonic() - began >= time_limit:
                return
            if self.has_ended(state):
                return
            state = self.step(state)
            yield state

    def describe(self, state: State) -> list[Generation]:
        """Return one row for each run."""
        fitness = np.asarray(state.population.fitness)
        best = fitness.argmax(axis=1)
        rows = np.arange(len(best))
        best_trees = jax.tree.map(lambda leaf: np.asarray(leaf)[rows, best], state.population.trees)
        shared = [self._baseline_in(tree) for tree in (best_trees[run] for run in rows)]
        entropy, distance = jax.device_get(diversity_of(self.keys, np.int32(state.generation), state.population))
        return [
            Generation(
                run=run,
                generation=state.generation,
                episodes=state.trees_measured[run] * self.episodes_per_tree,
                best=float(row[best[run]]),
                mean=float(row.mean()),
                std=float(row.std()),
                nodes=int(best_trees.sizes[run, 0]),
                fitness_entropy=float(entropy[run]),
                edit_distance=float(distance[run]),
                baseline_leaves=shared[run][0],
                baseline_child=shared[run][1],
                **self._learnt(state, run),
            )
            for run, row in enumerate(fitness)
        ]

    def _learnt(self, state: State, run: int) -> dict[str, Any]:
        """Return what a generation tells of the knowledge of a run, if it has any."""
        return state.knowledge[run].summary() if state.knowledge else {}

    def _baseline_in(self, tree: Trees) -> tuple[int, int]:
        """How many leaves of a tree [N] are the baseline's, and the child of the root that has the first; 0 and -1."""
        if self.baseline is None:
            return 0, -1
        known = self.baseline.tokens[self.baseline.tokens >= FIRST_LEAF]
        places = np.flatnonzero(np.isin(tree.tokens, known))
        if not places.size or tree.sizes[0] == 1:
            return len(places), -1
        child, count = 1, 0
        while child + tree.sizes[child] <= places[0]:
            child, count = child + int(tree.sizes[child]), count + 1
        return len(places), count


def best_of(state: State) -> tuple[Trees, Float32[np.ndarray, " R"]]:
    """Return the best tree of each run [R, N] and its fitness; of equals, the first."""
    trees, fitness = jax.device_get((state.population.trees, state.population.fitness))
    best = fitness.argmax(axis=1)
    rows = np.arange(len(best))
    return trees[rows, best], fitness[rows, best]


def _merged(old: UInt64[np.ndarray, " _"], new: UInt64[np.ndarray, " _"]) -> UInt64[np.ndarray, " _"]:
    """Union of two sorted arrays without repeats, in time linear in their lengths."""
    place = np.searchsorted(old, new)
    fresh = np.ones(len(new), bool)
    inside = place < len(old)
    fresh[inside] = old[place[inside]] != new[inside]
    return np.insert(old, place[fresh], new[fresh])


def on_device(values: np.ndarray, dtype: type = np.float32) -> Array:
    """Return a copy as a JAX array; `jnp.asarray` would compile something for each shape."""
    return jax.device_put(np.array(values, dtype))


def now_seen(seen: tuple[np.ndarray, ...], trees: Trees) -> tuple[UInt64[np.ndarray, " _"], ...]:
    """Add the hashes of trees [R, M, N] to those seen by each run."""
    halves = np.asarray(hashes_of(trees)).astype(np.uint64)
    hashes = halves[..., 0] << np.uint64(32) | halves[..., 1]
    return tuple(_merged(old, np.unique(new)) for old, new in zip(seen, hashes, strict=True))
