"""The search: R independent runs, one batch of offspring after the other.

Every random number follows from the seed, the run and the generation, as in `gp.evolution`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import jax
import numpy as np
from jaxtyping import Bool, Int, Int8, UInt64

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.archive import PER_KEY
from bt_jax.gp.achievements.breeding import Origin, built, origins, varied
from bt_jax.gp.achievements.decorating import bare, decorated, decoration_of, hardened
from bt_jax.gp.achievements.goals import Goals, Measured
from bt_jax.gp.achievements.knowledge import Knowledge
from bt_jax.gp.achievements.nodes import first_decorator
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import PATIENCE, GPConfig
from bt_jax.gp.mutation import EditRates
from bt_jax.gp.procedure import Procedure, State, now_seen, on_device
from bt_jax.gp.random_trees import growth
from bt_jax.gp.steps import Population, first_trees, hashes_of

__all__ = ["AchievementSearch"]

CAREFUL = 2  # by how much patience grows where episodes differ by chance
ROUNDS = 8  # in which what is not valid or not new is drawn again; in the second half everything is mutated


def _nothing(trees: Trees) -> Measured:
    raise ValueError("this AchievementSearch measures nothing; give it `evaluate`, or use ask and tell")


class AchievementSearch(Procedure):
    """Search for trees by what episodes tell besides the fitness: which achievements a tree has, and what each of its leaves
    returned.

    The search knows no domain but `Goals`, and the kinds of the tokens. You measure the trees:

        state = None
        for _ in range(1 + config.num_generations):
            offspring = search.ask(state)
            state = search.tell(state, offspring, measure(offspring))

    or give `evaluate`, which takes Trees [R, P, N] and returns `Measured`, and call `step` or `run`. The population of a
    state is its best tree and what was measured last; `config.population` trees are measured each generation. A run has
    ended once its best tree solves the task and was not improved for `config.patience` generations; unless that is given,
    for PATIENCE, and twice as many where episodes differ by chance. `confirm`, if given, then takes the run and its best
    trees [K, N], and returns what they achieve in more layouts; the run goes on unless one solves the task there, too. With
    `config.accept_baseline` it takes the baseline first, and a run whose baseline solves all of them has ended.
    """

    def __init__(
        self,
        config: GPConfig,
        kinds: Int8[np.ndarray, " V"],
        goals: Goals,
        evaluate: Callable[[Trees], Measured] = _nothing,
        *,
        confirm: Callable[[int, Trees], Measured] | None = None,
        baseline: Trees | None = None,
        episodes_per_tree: int = 1,
    ) -> None:
        config = dataclasses.replace(config, method="achievements")
        config.check()
        goals.check()
        alphabet = Alphabet.of_kinds(kinds)
        alphabet.check()
        super().__init__(config, baseline=baseline, episodes_per_tree=episodes_per_tree)
        self.kinds, self.goals, self.evaluate, self.confirm = kinds, goals, evaluate, confirm
        self._patience = PATIENCE * (1 if goals.often == 1 else CAREFUL) if config.patience is None else config.patience
        self._decorates = first_decorator(kinds) < len(kinds)
        self._before = np.zeros((len(kinds), 0), np.int32) if goals.before is None else goals.before
        self._alphabet = jax.tree.map(lambda count: np.array(count, np.int32), alphabet)
        self._rates = EditRates.of(alphabet, config.mutation)
        self._first_rates = EditRates.of(alphabet, growth(gene_under_fallback=config.gene_under_fallback))
        self._static = dataclasses.replace(config, seed=0, generations=1, accept_baseline=False)

    def ask(self, state: State | None) -> Trees:
        """Return the offspring [R, P, N] to measure next (NumPy); the baseline, if any, is the first of all."""
        config = self.config
        if state is None:
            spare = jax.device_get(first_trees(self.keys, self._alphabet, self._first_rates, self._static))
            knowledge = (Knowledge.empty(self.goals, config.max_nodes, self.baseline),) * config.runs
            seen, generation = (np.empty(0, np.uint64),) * config.runs, 0
        else:
            spare, knowledge = jax.device_get(state.population.trees), state.knowledge
            seen, generation = state.seen, state.generation + 1
        bred = [
            self._bred(np.random.default_rng([config.seed + run, generation]), known, spare[run], seen[run])
            for run, known in enumerate(knowledge)
        ]
        trees = _stacked(bred)
        if state is None and self.baseline is not None:
            trees.tokens[:, 0], trees.sizes[:, 0] = self.baseline.tokens, self.baseline.sizes
        return trees

    def _bred(
        self, rng: np.random.Generator, knowledge: Knowledge, spare: Trees, seen: UInt64[np.ndarray, " _"]
    ) -> Trees:
        """Return P valid trees, no two of them equal and none seen, as far as such are found in a few rounds. The spare
        trees are the parents while the archive is empty."""
        config, archive, goals = self.config, knowledge.archive, self.goals
        count = len(spare.tokens)
        result = Trees(spare.tokens.copy(), spare.sizes.copy())
        missing = np.ones(count, bool)
        for turn in range(ROUNDS):
            origin = origins(rng, knowledge, goals, count, hardens=self._decorates)
            if len(archive):
                pairs = archive.parents(rng, (2, count))
                first, second = archive.trees[pairs[0]], archive.trees[pairs[1]]
                achieved = archive.achieved(len(goals.concerns))[pairs[0]]
                missed = archive.missed[pairs[0]]
            else:
                first, second, achieved = spare, spare, np.zeros((count, len(goals.concerns)), bool)
                missed = np.zeros(achieved.shape, np.float32)
            parents = first
            if self._decorates:
                first, second = self._bare(first), self._bare(second)
            trees, made = built(rng, origin, first, achieved, missed, knowledge, goals, self.kinds)
            origin = np.where((origin < Origin.CROSSED) & ~made | (turn >= ROUNDS // 2), Origin.MUTATED, origin)
            steps = np.where(origin == Origin.MUTATED, self._chain_lengths(rng, count) + turn, 0)
            key = rng.integers(1 << 32, size=2, dtype=np.uint64).astype(np.uint32)
            mutation = config.mutation
            trees, valid, halves = jax.device_get(
                varied(key, first, second, trees, origin, steps, self._alphabet, self._rates, mutation)
            )
            if self._decorates:
                trees, valid = self._decorated(rng, parents, trees, origin, valid, knowledge)
                halves = np.asarray(hashes_of(trees[None]))[0]
            hashes = halves[:, 0].astype(np.uint64) << np.uint64(32) | halves[:, 1]
            once = np.zeros(count, bool)
            once[np.unique(hashes, return_index=True)[1]] = True
            new = missing & valid & once & ~np.isin(hashes, seen)
            result.tokens[new], result.sizes[new] = trees.tokens[new], trees.sizes[new]
            seen, missing = np.append(seen, hashes[new]), missing & ~new
            if not missing.any():
                break
        return result

    def _bare(self, trees: Trees) -> Trees:
        """Return trees [M, N] without their decorators."""
        return _stacked([bare(trees[row], self.kinds) for row in range(len(trees.tokens))])

    def _decorated(
        self,
        rng: np.random.Generator,
        parents: Trees,
        trees: Trees,
        origin: Int[np.ndarray, " M"],
        valid: Bool[np.ndarray, " M"],
        knowledge: Knowledge,
    ) -> tuple[Trees, Bool[np.ndarray, " M"]]:
        """Return M bare offspring [M, N] with the decorators of their parents, and hardened parents in place of those that
        are to be; and which are valid."""
        found, valid, failing = [], valid.copy(), knowledge.linkage.failing()
        for row in range(len(valid)):
            if origin[row] == Origin.HARDENED:
                tree = hardened(
                    rng,
                    parents[row],
                    failing,
                    self._before,
                    self.kinds,
                    gene_under_fallback=self.config.gene_under_fallback,
                )
                valid[row] = tree is not None
                found.append(parents[row] if tree is None else tree)
            elif valid[row]:
                found.append(decorated(trees[row], decoration_of(parents[row], self.kinds), self.kinds))
            else:
                found.append(trees[row])
        return _stacked(found), valid

    def _chain_lengths(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return how many mutations make each offspring, as `gp.mutation.chain_lengths` does."""
        weights = self.config.chain_ratio ** np.arange(self.config.max_mutations)
        return 1 + rng.choice(len(weights), size=count, p=weights / weights.sum())

    def tell(self, state: State | None, offspring: Trees, measured: Measured) -> State:
        """Return the state after the offspring [R, P, N] that `ask` gave for `state` were measured. Raise ValueError unless
        every fitness is finite."""
        if not np.isfinite(measured.fitness).all():
            raise ValueError(
                "a fitness is not finite; give a tree that cannot be measured a very low one, such as -1e6"
            )
        if state is None:
            generation, earlier, seen = 0, (0,) * self.config.runs, (np.empty(0, np.uint64),) * self.config.runs
            knowledge = (Knowledge.empty(self.goals, self.config.max_nodes, self.baseline),) * self.config.runs
            baseline_fitness = on_device(measured.fitness[:, 0])
        else:
            generation, earlier, seen = state.generation + 1, state.earlier, state.seen
            knowledge, baseline_fitness = state.knowledge, state.baseline_fitness
        learnt = tuple(
            known.updated(
                offspring[run],
                jax.tree.map(lambda leaf, run=run: leaf[run], measured),
                self.goals,
                self.kinds,
                gene_under_fallback=self.config.gene_under_fallback,
            )
            for run, known in enumerate(knowledge)
        )
        population = _population(offspring, measured, learnt)
        return State(population, generation, baseline_fitness, now_seen(seen, offspring), earlier, learnt)

    def step(self, state: State | None) -> State:
        """Return the state one generation later, or for None the first: `ask`, `evaluate`, `tell`, and `confirm` for the
        runs that have just come to their end."""
        begins = state is None
        offspring = self.ask(state)
        measured = self.evaluate(offspring)
        state = self.tell(state, offspring, measured)
        if self.confirm is None:
            return state
        if begins and self._baseline_does(measured):
            every = np.zeros(self.config.population, int)  # the baseline comes first
            offspring, measured = jax.tree.map(lambda leaf: leaf[:, every], (offspring, measured))
            learnt = tuple(self._settled(run, known, offspring, measured) for run, known in enumerate(state.knowledge))
        else:
            learnt = tuple(self._confirmed(run, known) for run, known in enumerate(state.knowledge))
        return dataclasses.replace(state, knowledge=learnt, population=_population(offspring, measured, learnt))

    def _baseline_does(self, measured: Measured) -> bool:
        """Return whether the baseline is to be accepted: whether it solves every episode, and those of `confirm`."""
        if not self.config.accept_baseline or self.baseline is None or self.confirm is None:
            return False
        if not (measured.solved[:, 0] == 1).all():
            return False
        return all(self.confirm(run, self.baseline[None]).solved[0] == 1 for run in range(self.config.runs))

    def _settled(self, run: int, known: Knowledge, trees: Trees, measured: Measured) -> Knowledge:
        """Return what a run knows that needs nothing but the first of its trees."""
        first = jax.tree.map(lambda leaf: leaf[run, :1], measured)
        return known.settled(trees[run, :1], first, self.goals, stagnant=self._patience)

    def _confirmed(self, run: int, known: Knowledge) -> Knowledge:
        """Return what a run knows after its best trees were tried in more layouts, if it is time for that."""
        if self.confirm is None or not known.solved or known.stagnant != self._patience:
            return known
        rows = known.complete(self.goals)[:PER_KEY]
        return known.tried(rows, self.confirm(run, known.archive.trees[rows]), self.goals)

    def adopt(self, trees: Trees, *, generation: int, earlier: Sequence[int]) -> State:
        """Go on with trees [R, P, N] that were bred for another fitness, in the order of `kept`: what was learnt begins with
        their episodes. The baseline, if any, comes first, as in `ask`, and the last tree goes."""
        trees = jax.tree.map(np.array, jax.device_get(trees))
        if self.baseline is not None:
            trees = jax.tree.map(lambda all_: np.roll(all_, 1, axis=1), trees)
            trees.tokens[:, 0], trees.sizes[:, 0] = self.baseline.tokens, self.baseline.sizes
        state = self.tell(None, trees, self.evaluate(trees))
        return dataclasses.replace(state, generation=generation, earlier=tuple(earlier))

    def kept(self, state: State) -> Trees:
        """Return the trees [R, P, N] of the archives that achieve the most, again from the first if there are fewer."""
        found = []
        for known in state.knowledge:
            archive = known.archive
            order = np.lexsort((-archive.fitness, -np.bitwise_count(archive.keys).astype(int)))
            found.append(archive.trees[np.resize(order, self.config.population)])
        return _stacked(found)

    def has_ended(self, state: State) -> bool:
        """Return whether all runs have solved their task and none improves any more."""
        if self.config.num_patience is None:
            return False
        return all(known.solved and known.stagnant >= self._patience for known in state.knowledge)


def _stacked(trees: Sequence[Trees]) -> Trees:
    return Trees(np.stack([tree.tokens for tree in trees]), np.stack([tree.sizes for tree in trees]))


def _population(offspring: Trees, measured: Measured, knowledge: tuple[Knowledge, ...]) -> Population:
    """Return the best tree of each run with the offspring [R, P, N], in place of the worst of them."""
    tokens, sizes = offspring.tokens.copy(), offspring.sizes.copy()
    fitness = measured.fitness.astype(np.float32)
    for run, known in enumerate(knowledge):
        best, worst = int(known.archive.fitness.argmax()), int(fitness[run].argmin())
        tree = known.archive.trees[best]
        tokens[run, worst], sizes[run, worst] = tokens[run, 0], sizes[run, 0]
        fitness[run, worst] = fitness[run, 0]
        tokens[run, 0], sizes[run, 0], fitness[run, 0] = tree.tokens, tree.sizes, known.archive.fitness[best]
    return Population(jax.device_put(Trees(tokens, sizes)), on_device(fitness))
