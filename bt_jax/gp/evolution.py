"""The evolution: R independent runs of a population, one generation after the other.

Every random number follows from the seed, the run and the generation, so a state needs no generator: going on from a
saved state gives exactly what never stopping would have given, and run r of several is the single run of seed + r.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import jax
import numpy as np
from jaxtyping import Array, Int, Int32, Real

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.mutation import EditRates
from bt_jax.gp.procedure import Generation, Procedure, State, best_of, now_seen, on_device
from bt_jax.gp.random_trees import growth
from bt_jax.gp.steps import Population, diversity_of, first_trees, offspring_of, survivors_of

__all__ = ["Evaluate", "Evolution", "Generation", "Population", "State", "best_of"]

Fitness = Real[np.ndarray, "R P"] | Real[Array, "R P"]
Niched = tuple[Fitness, Int32[np.ndarray, "R P"]]
Evaluate = Callable[[Trees], Fitness | Niched]


def _nothing(trees: Trees) -> Fitness:
    raise ValueError("this Evolution has no fitness function; give it one, or use ask and tell")


class Evolution(Procedure):
    """Evolve R populations, of any alphabet and for any fitness; higher fitness is better.

    You measure the trees yourself:

        state = None
        for _ in range(1 + config.num_generations):
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
        config = dataclasses.replace(config, method="population")
        config.check()
        alphabet.check()
        super().__init__(config, baseline=baseline, episodes_per_tree=episodes_per_tree)
        self.alphabet, self.evaluate = alphabet, evaluate
        # What compiled code depends on: runs that differ in nothing else share it.
        self._static = dataclasses.replace(config, seed=0, generations=1)
        # What it is given as arrays, so that evolutions for different tasks share it.
        self._alphabet = jax.tree.map(lambda count: np.array(count, np.int32), alphabet)
        self._rates = EditRates.of(alphabet, config.mutation)

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
            niche = on_device(np.zeros((runs, count)), np.int32) if self.config.niches else None
            return Population(trees, on_device(np.zeros((runs, count))), niche)

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
        return State(population, generation, state.baseline_fitness, now_seen(state.seen, offspring), state.earlier)

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
        return State(population, generation, on_device(baseline_fitness), now_seen(nothing, population.trees), earlier)

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
            return Population(trees, on_device(values))
        niche = achieved * (self.config.max_nodes + 1) + np.asarray(trees.sizes)[..., 0]
        return Population(trees, on_device(values), on_device(niche, np.int32))
