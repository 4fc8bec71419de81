"""Evolving a Behavior Tree for a task: what `python -m bt_jax.train` does, as a library."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float32, Int32
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.behaviors import FIRST_LEAF, Behavior, Decorator, Tree, gene_pool
from bt_jax.encoding.arrays import Trees, decode, encode
from bt_jax.encoding.walk import decorators, leaves
from bt_jax.gp.achievements.goals import Measured
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Evolution, Generation, State, best_of
from bt_jax.gp.procedure import Procedure
from bt_jax.gp.search import AchievementSearch
from bt_jax.mjx_env.episodes.adaptive import AdaptiveEvaluator
from bt_jax.mjx_env.episodes.evaluator import Evaluation, TableEvaluator
from bt_jax.mjx_env.episodes.rollout import RolloutEvaluator
from bt_jax.mjx_env.faults.fates import Fates, joined, sample_episodes
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import World, concatenate
from bt_jax.tasks import Task
from bt_jax.training.bar import GenerationBar, is_interactive
from bt_jax.training.baseline import evolvable
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.goals import enough, goals_of, measured
from bt_jax.training.levels import make_level
from bt_jax.training.result import Result, Test
from bt_jax.training.run_config import RunConfig
from bt_jax.training.settings import CONFIRMED, CONFIRMING, UNSEEN, Settings
from bt_jax.training.testing import as_test, explained

__all__ = ["Training", "evolve"]

GB = 1 << 30  # bytes


class Training:
    """An evolution bound to a task: individuals are trees over the task's gene pool, fitness comes from episodes.

    `extra_leaves` join the pool, from which those of `without` are missing; `baseline` is a tree that the population starts
    from and keeps for crossover, and its leaves join as well. Run r uses layouts of its own, drawn from seed + r, the same
    in every generation.
    """

    def __init__(
        self,
        task: Task,
        config: GPConfig = GPConfig(),  # noqa: B008
        settings: Settings = Settings(),  # noqa: B008
        *,
        baseline: Tree | None = None,
        extra_leaves: tuple[Behavior, ...] = (),
        without: tuple[Behavior, ...] = (),
    ) -> None:
        config.check()
        settings.check()
        self.task, self.config, self.settings = task, config, settings
        baseline = None if baseline is None else evolvable(baseline, config)
        own = [] if baseline is None else leaves(baseline)
        if used := next((leaf for leaf in without if leaf in own), None):
            raise UserError(
                f"the baseline uses {used}, which evolution is to do without; take it out of one of the two"
            )
        counting = [] if baseline is None else decorators(baseline)
        self.vocabulary = gene_pool(task).without(without).extended([*extra_leaves, *own], counting)
        self.level = make_level(task, settings)
        self.run_config = _pinned(
            RunConfig(task, config, settings, baseline, extra_leaves, without=without), self.level.name
        )
        learns = config.method == "achievements"
        batch = config.runs * (config.population if learns else max(config.population, config.num_offspring))
        semantics = LeafSemantics(task, self.vocabulary)
        table = TableEvaluator(semantics, self.level, batch=batch, memory=int(settings.memory * GB), trace=learns)
        self.table = table.table
        self.evaluator: TableEvaluator | AdaptiveEvaluator | RolloutEvaluator = table
        if settings.evaluator == "rollout":
            self.evaluator = RolloutEvaluator(semantics, self.level, batch=batch, trace=learns)
        elif task.faults is not None:
            self.evaluator = AdaptiveEvaluator(table, self.level)
        self.draws, self.episodes_per_tree = settings.draws_of(task), settings.episodes(task)
        episodes = [
            sample_episodes(task, config.seed + run, layouts=settings.layouts_of(task), draws=self.draws)
            for run in range(config.runs)
        ]
        self.layouts = concatenate([starts for starts, _ in episodes])
        self.fates = joined([fates for _, fates in episodes if fates is not None]) if task.faults else None
        self.evolution = self._procedure(
            None if baseline is None else encode(baseline, self.vocabulary, config.max_nodes)
        )

    def _procedure(self, baseline: Trees | None) -> Procedure:
        """Return what evolves the trees."""
        per_tree = self.episodes_per_tree
        if self.config.method == "achievements":
            goals = goals_of(self.task, self.vocabulary)
            return AchievementSearch(
                self.config,
                self.vocabulary.kinds,
                goals,
                self._measured,
                confirm=self._confirm,
                baseline=baseline,
                episodes_per_tree=per_tree,
            )
        return Evolution(
            self.config,
            Alphabet.of(self.vocabulary),
            self._measure if self.config.niches else self._fitness,
            baseline=baseline,
            episodes_per_tree=per_tree,
        )

    @staticmethod
    def of(config: RunConfig) -> Training:
        """Return the training of a configuration."""
        training = Training(
            config.task,
            config.gp,
            config.settings,
            baseline=config.baseline,
            extra_leaves=config.extra_leaves,
            without=config.without,
        )
        training.run_config = _pinned(config, training.level.name)
        return training

    def _fitness(self, trees: Trees) -> Float32[np.ndarray, "R P"]:
        return self._evaluation(trees).lower_mean(self.settings.robust).reshape(trees.tokens.shape[:2])

    def _measure(self, trees: Trees) -> tuple[Float32[np.ndarray, "R P"], Int32[np.ndarray, "R P"]]:
        """Return the fitness, and what was achieved: the targets within the tolerance at the end, in enough episodes, as
        bits, above them the number of subgoals missed in the worst."""
        result, shape = self._evaluation(trees), trees.tokens.shape[:2]
        met = result.misses.met.mean(axis=1) >= enough(self.task)
        achieved = (result.subgoals_missed.max(axis=1) << met.shape[1]) | met @ (1 << np.arange(met.shape[1]))
        return result.lower_mean(self.settings.robust).reshape(shape), achieved.astype(np.int32).reshape(shape)

    def _measured(self, trees: Trees) -> Measured:
        runs, population, _ = trees.tokens.shape
        return measured(self._evaluation(trees), self.task, (runs, population), robust=self.settings.robust)

    def _confirm(self, run: int, trees: Trees) -> Measured:
        """Return what K trees [K, N] achieve in layouts that are neither those of the run nor those of the test."""
        seed, count = [CONFIRMING, self.config.seed + run], len(trees.tokens)
        layouts, fates = sample_episodes(self.task, seed, layouts=CONFIRMED, draws=self.draws)
        each, own = self._copies(trees, len(layouts.held))
        result = self.evaluator(each, layouts, own, fates)
        found = measured(result, self.task, (count, len(own) // count), robust=self.settings.robust)
        return Measured(
            fitness=found.fitness.mean(axis=1),
            solved=result.solved.reshape(count, -1).mean(axis=1, dtype=np.float32),
            achieved=found.achieved.mean(axis=1),
            missed=found.missed.mean(axis=1),
            trace=np.bitwise_or.reduce(found.trace, axis=1),
        )

    def _copies(self, trees: Trees, count: int) -> tuple[Trees, Int32[np.ndarray, "E K"]]:
        """Return each of several trees [K, N] as often as it takes to be measured in `count` episodes, as many at once as in
        training, and the episodes of each."""
        per_tree = self.episodes_per_tree
        copies = -(-count // per_tree)
        which = np.minimum(np.arange(copies * per_tree, dtype=np.int32), count - 1).reshape(copies, per_tree)
        each = jax.tree.map(lambda leaf: np.repeat(leaf, copies, axis=0), trees)
        return each, np.tile(which, (len(trees.tokens), 1))

    def _evaluation(self, trees: Trees) -> Evaluation:
        runs, population, _ = trees.tokens.shape
        count = self.episodes_per_tree
        own = np.arange(runs * count, dtype=np.int32).reshape(runs, 1, count)
        which = np.broadcast_to(own, (runs, population, count)).reshape(-1, count)
        flat = jax.tree.map(lambda leaf: leaf.reshape(-1, leaf.shape[-1]), jax.device_get(trees))
        return self.evaluator(flat, self.layouts, which, self.fates)

    def carried(self, state: State, symbols: Sequence[Behavior | Decorator]) -> State:
        """Return the populations of a training whose vocabulary has these symbols, measured for this one's task: so
        evolution goes on with another target, more genes or a baseline. Raise UserError if one is not in this
        vocabulary."""
        tokens = np.array([*range(FIRST_LEAF), *map(self.vocabulary.token, symbols)], np.int16)
        old = jax.device_get(self.evolution.kept(state))
        trees = Trees(jnp.asarray(tokens[old.tokens]), jnp.asarray(old.sizes))
        return self.evolution.adopt(trees, generation=state.generation, earlier=state.trees_measured)

    def best_trees(self, state: State) -> list[Tree]:
        """Return the best tree of each run."""
        trees, _ = best_of(state)
        return [decode(trees[run], self.vocabulary) for run in range(self.config.runs)]

    def best_tree(self, state: State) -> Tree:
        """Return the best tree over all runs."""
        return self.best_trees(state)[int(best_of(state)[1].argmax())]

    @property
    def num_broken(self) -> int:
        """How many simulations diverged: transitions with the table, episodes with the rollout."""
        return self.evaluator.num_broken

    def result(self, state: State, history: list[Generation]) -> Result:
        """Return the best trees, the best of all tested in unseen layouts."""
        checkpoint = Checkpoint(state, self.vocabulary.symbols, self.run_config.phase, history, self.run_config)
        tree = self.best_tree(state)
        layouts, fates = self._unseen(self.settings.test_layouts)
        test = explained(self.test(tree), self.table.semantics, self.table.settler, tree, layouts, fates)
        return Result(self.run_config, checkpoint, self.best_trees(state), test)

    def test(self, tree: Tree, *, count: int | None = None) -> Test:
        """Run a tree in `count` layouts (default: `test_layouts`) that no run of this training has seen, and where things go
        wrong in several draws of each."""
        layouts, fates = self._unseen(self.settings.test_layouts if count is None else count)
        rows = len(layouts.held)
        trees, which = self._copies(encode(tree, self.vocabulary, self.config.max_nodes)[None], rows)
        return as_test(self.evaluator(trees, layouts, which, fates), rows, draws=self.draws)

    def _unseen(self, count: int) -> tuple[World, Fates | None]:
        return sample_episodes(self.task, [UNSEEN, self.config.seed], layouts=count, draws=self.draws)


def _pinned(config: RunConfig, level: str) -> RunConfig:
    """Return the configuration with the backend that `auto` stands for here and the precision of JAX, so that a resumed run
    takes the same."""
    settings: dict[str, Any] = {"backend": level} if config.settings.level == "physics" else {}
    x64 = bool(jax.config.jax_enable_x64)  # type: ignore[attr-defined]  # JAX makes it while it is imported
    return dataclasses.replace(config, settings=dataclasses.replace(config.settings, **settings), x64=x64)


def evolve(
    task: Task,
    config: GPConfig = GPConfig(),  # noqa: B008
    settings: Settings = Settings(),  # noqa: B008
    *,
    baseline: Tree | None = None,
    target: float | None = None,
    time_limit: float | None = None,
    hook: Callable[[Training, State], None] | None = None,
    extra_leaves: tuple[Behavior, ...] = (),
    without: tuple[Behavior, ...] = (),
    progress: bool | None = None,
) -> Result:
    """Evolve a tree for a task and test it in unseen layouts.

    `baseline` is a tree to start from, `extra_leaves` join the gene pool, and `without` leave it. The evolution ends at its
    last generation, once every run has the `target` fitness, or after `time_limit` seconds; `hook` is called after each
    generation.
    `progress` shows the generations on the console (default: at a prompt and in a notebook).
    """
    training = Training(task, config, settings, baseline=baseline, extra_leaves=extra_leaves, without=without)
    history: list[Generation] = []
    console = Console(quiet=not (is_interactive() if progress is None else progress))
    bar = GenerationBar(console, config.num_generations, by_chance=task.faults is not None)
    with bar:
        for state in training.evolution.run(target=target, time_limit=time_limit):
            rows = training.evolution.describe(state)
            history += rows
            bar.update(rows)
            if hook is not None:
                hook(training, state)
    return training.result(state, history)
