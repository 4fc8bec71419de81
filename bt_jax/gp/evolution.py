"""The evolution: R independent runs of a population, one generation after the other.

Every random number follows from the seed, the run and the generation, so a state needs no generator: going on from a
saved state gives exactly what never stopping would have given, and run r of several is the single run of seed + r.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence

import jax
import numpy as np
from jaxtyping import Array, Float32, Int, Int32, Real, UInt64

from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.mutation import EditRates
from bt_jax.gp.random_trees import growth
from bt_jax.gp.steps import Population, diversity_of, first_trees, hashes_of, offspring_of, run_keys, survivors_of

__all__ = ["Evaluate", "Evolution", "Generation", "Population", "State", "best_of"]

Fitness = Real[np.ndarray, "R P"] | Real[Array, "R P"]
Niched = tuple[Fitness, Int32[np.ndarray, "R P"]]
Evaluate = Callable[[Trees], Fitness | Niched]


@dataclasses.dataclass(frozen=True)
class State:
    """Everything that the next generation depends on, and what was measured so far."""

    population: Population
    generation: int
    baseline_fitness: Float32[Array, " R"]  # of the baseline if there is one, else of an individual at the start
    seen: tuple[UInt64[np.ndarray, " _"], ...]  # for each run the hashes of all trees measured, sorted
    earlier: tuple[int, ...]  # for each run, how many were measured before, for another fitness

    @property
    def trees_measured(self) -> list[int]:
        """How many distinct trees each run has measured."""
        return [before + len(hashes) for before, hashes in zip(self.earlier, self.seen, strict=True)]


@dataclasses.dataclass(frozen=True)
class Generation:
    """One run after one generation. `episodes`: distinct trees measured so far, times the layouts in which each is.

    `baseline_leaves` is how many leaves of the best tree are leaves of the baseline, `baseline_child` the child of the root,
    counted from 0, under which the first of them stands; -1 if there is none.
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


def _nothing(trees: Trees) -> Fitness:
    raise ValueError("this Evolution has no fitness function; give it one, or use ask and tell")


class Evolution:
    """Evolve R populations, of any alphabet and for any fitness; higher fitness is better.

    You measure the trees yourself:

        state = None
        for _ in range(1 + config.generations):
            offspring = evolution.ask(state)
            state = evolution.tell(state, offspring, fitness(offspring))

    or give `evaluate`, which takes Trees [R, P, N] and returns their fitness [R, P], and call `step` or `run`. With
    `config.niches` the fitness is a pair: the fitness itself and int[R, P], 0 or more, equal for individuals that have
    achieved the same: with the number of nodes, their niche. `episodes_per_tree` only serves to count episodes.
    """

    def __init__(
        self,
        config: GPConfig,
        alphabet: Alphabet,
        evaluate: Evaluate = _nothing,
        *,
        baseline: Trees | None = None,
        episodes_per_tree: int = 1,
    ) -> None:
        config.check()
        alphabet.check()
        self.config, self.alphabet, self.evaluate, self.baseline = config, alphabet, evaluate, baseline
        self.episodes_per_tree = episodes_per_tree
        # What compiled code depends on: runs that differ in nothing else share it.
        self._static = dataclasses.replace(config, seed=0, generations=1)
        # What it is given as arrays, so that evolutions for different tasks share it.
        self._alphabet = jax.tree.map(lambda count: np.array(count, np.int32), alphabet)
        self._rates = EditRates.of(alphabet, config.mutation)
        self.keys = run_keys(np.arange(config.seed, config.seed + config.runs, dtype=np.uint32))

    def ask(self, state: State | None) -> Trees:
        """Return the offspring [R, M, N] to measure next: those of a state, or for None the first, random populations
        [R, P, N], in which the baseline, if any, takes the place of individual 0."""
        if state is None:
            self._prepare()
            rates = EditRates.of(self.alphabet, growth(gene_under_fallback=self.config.gene_under_fallback))
            trees = first_trees(self.keys, self._alphabet, rates, self._static)
            return self._with_baseline(trees, np.zeros(self.config.runs, int))
        now = np.int32(state.generation + 1)
        return offspring_of(
            self.keys,
            now,
            state.population,
            self._alphabet,
            self._rates,
            self._static,
            self.baseline,
            state.baseline_fitness,
        )

    def _prepare(self) -> None:
        """Begin to compile the steps that the first population is not made with."""

        runs, nodes = self.config.runs, self.config.max_nodes

        def population(count: int) -> Population:
            trees = Trees(np.zeros((runs, count, nodes), np.int16), np.zeros((runs, count, nodes), np.uint8))
            niche = _on_device(np.zeros((runs, count)), np.int32) if self.config.niches else None
            return Population(trees, _on_device(np.zeros((runs, count))), niche)

        now = np.int32(1)
        old, offspring = population(self.config.population), population(self.config.num_offspring)
        fitness = np.zeros(runs, np.float32)
        offspring_of.prepare(self.keys, now, old, self._alphabet, self._rates, self._static, self.baseline, fitness)
        diversity_of.prepare(self.keys, now, old)
        survivors_of.prepare(self.keys, now, old, offspring, self._static)

    def tell(self, state: State | None, offspring: Trees, fitness: Fitness | Niched) -> State:
        """Return the state after the offspring [R, M, N] that `ask` gave for `state` were measured: who survives.

        Raise ValueError unless there is one finite fitness for each."""
        measured = self._population(offspring, fitness)
        if state is None:
            first = np.zeros(self.config.runs, int)
            return self._begun(measured, first, generation=0, earlier=(0,) * self.config.runs)
        generation = state.generation + 1
        population = survivors_of(self.keys, np.int32(generation), state.population, measured, self._static)
        return State(population, generation, state.baseline_fitness, _now_seen(state.seen, offspring), state.earlier)

    def step(self, state: State | None) -> State:
        """Return the state one generation later, or for None the first: `ask`, `evaluate`, `tell`."""
        offspring = self.ask(state)
        return self.tell(state, offspring, self.evaluate(offspring))

    def adopt(self, trees: Trees, *, generation: int, earlier: Sequence[int]) -> State:
        """Go on with populations [R, P, N] that were bred for another fitness: they are measured again, and the baseline,
        if any, takes the place of the worst. `earlier` is how many trees each run has measured so far."""
        worst = np.asarray(self._population(trees, self.evaluate(trees)).fitness).argmin(axis=1)
        trees = self._with_baseline(trees, worst)
        population = self._population(trees, self.evaluate(trees))
        return self._begun(population, worst, generation=generation, earlier=tuple(earlier))

    def _with_baseline(self, trees: Trees, places: Int[np.ndarray, " R"]) -> Trees:
        """Return the populations with the baseline, if any, in one place of each."""
        if self.baseline is None:
            return trees
        rows = np.arange(len(places))
        return jax.tree.map(lambda all_, one: all_.at[rows, places].set(one), trees, self.baseline)

    def _begun(
        self, population: Population, places: Int[np.ndarray, " R"], *, generation: int, earlier: tuple[int, ...]
    ) -> State:
        """Return the state that begins with a population; the individuals at `places` give the fitness of the baseline."""
        nothing = (np.empty(0, np.uint64),) * self.config.runs
        baseline_fitness = np.asarray(population.fitness)[np.arange(len(places)), places]
        return State(
            population, generation, _on_device(baseline_fitness), _now_seen(nothing, population.trees), earlier
        )

    def _population(self, trees: Trees, fitness: Fitness | Niched) -> Population:
        """Return trees [R, M, N] with what was measured of them. Raise ValueError for a fitness that is not finite, or not
        [R, M]."""
        if isinstance(fitness, tuple) != self.config.niches:
            raise ValueError("the fitness is a pair if, and only if, config.niches is set")
        values, achieved = fitness if isinstance(fitness, tuple) else (fitness, None)
        values, shape = np.asarray(values, np.float32), trees.sizes.shape[:2]
        if values.shape != shape:
            raise ValueError(f"the fitness has shape {values.shape}; give one value for each tree, {shape}")
        if not np.isfinite(values).all():
            raise ValueError(
                "a fitness is not finite; give a tree that cannot be measured a very low one, such as -1e6"
            )
        if achieved is None:
            return Population(trees, _on_device(values))
        niche = achieved * (self.config.max_nodes + 1) + np.asarray(trees.sizes)[..., 0]
        return Population(trees, _on_device(values), _on_device(niche, np.int32))

    def run(
        self, state: State | None = None, *, target: float | None = None, time_limit: float | None = None
    ) -> Iterator[State]:
        """Yield the state after each generation, the first or the given one included, until `config.generations`, until
        every run has reached the `target` fitness, or for `time_limit` seconds."""
        began = time.monotonic()
        state = self.step(None) if state is None else state
        yield state
        while state.generation < self.config.generations:
            if target is not None and np.asarray(state.population.fitness).max(axis=1).min() >= target:
                return
            if time_limit is not None and time.monotonic() - began >= time_limit:
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
            )
            for run, row in enumerate(fitness)
        ]

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


def _on_device(values: np.ndarray, dtype: type = np.float32) -> Array:
    """Return a copy as a JAX array; `jnp.asarray` would compile something for each shape."""
    return jax.device_put(np.array(values, dtype))


def best_of(state: State) -> tuple[Trees, Float32[np.ndarray, " R"]]:
    """Return the best tree of each run [R, N] and its fitness; of equals, the first."""
    trees, fitness = jax.device_get((state.population.trees, state.population.fitness))
    best = fitness.argmax(axis=1)
    rows = np.arange(len(best))
    return trees[rows, best], fitness[rows, best]


def _now_seen(seen: tuple[np.ndarray, ...], trees: Trees) -> tuple[UInt64[np.ndarray, " _"], ...]:
    """Add the hashes of trees [R, M, N] to those seen by each run."""
    halves = np.asarray(hashes_of(trees)).astype(np.uint64)
    hashes = halves[..., 0] << np.uint64(32) | halves[..., 1]
    return tuple(_merged(old, np.unique(new)) for old, new in zip(seen, hashes, strict=True))


def _merged(old: UInt64[np.ndarray, " _"], new: UInt64[np.ndarray, " _"]) -> UInt64[np.ndarray, " _"]:
    """Union of two sorted arrays without repeats, in time linear in their lengths."""
    place = np.searchsorted(old, new)
    fresh = np.ones(len(new), bool)
    inside = place < len(old)
    fresh[inside] = old[place[inside]] != new[inside]
    return np.insert(old, place[fresh], new[fresh])
