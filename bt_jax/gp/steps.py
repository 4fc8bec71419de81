"""The compiled steps of a generation, for R independent runs side by side."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float32, Int32, Key, UInt32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.diversity import fitness_entropy, mean_edit_distance
from bt_jax.gp.mutation import EditRates
from bt_jax.gp.novelty import hash_trees
from bt_jax.gp.random_trees import random_trees
from bt_jax.gp.reproduction import reproduce
from bt_jax.gp.selection import survivors

__all__ = ["Population", "diversity_of", "first_trees", "hashes_of", "offspring_of", "run_keys", "survivors_of"]

FEW = 32  # trees; more are worth optimizing for
RunKeys = UInt32[Array, "R 2"]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Population:
    """R populations with their fitness."""

    trees: Trees  # [R, P, N]
    fitness: Float32[Array, "*R P"]
    niche: Int32[Array, "*R P"] | None = None  # individuals of one niche compete; None: all with all


@kept_jit
def hashes_of(trees: Trees) -> UInt32[Array, "R M 2"]:
    return jax.vmap(hash_trees)(trees)


@kept_jit
def run_keys(seeds: UInt32[Array, " R"]) -> RunKeys:
    return jax.vmap(lambda seed: jax.random.key_data(jax.random.key(seed)))(seeds)


def _for_each_run(function: Callable, *arguments: Any) -> Any:
    """`jax.vmap`, but a single run is computed as such: batched loops and gathers take several times as long."""
    if jax.tree.leaves(arguments)[0].shape[0] > 1:
        return jax.vmap(function)(*arguments)
    return jax.tree.map(lambda leaf: leaf[None], function(*jax.tree.map(lambda leaf: leaf[0], arguments)))


class _Use(enum.IntEnum):
    """What the random numbers of one generation are for."""

    FIRST, OFFSPRING, SURVIVORS, DIVERSITY = range(4)


def _key(run_key: UInt32[Array, "2"], generation: Int32[Array, ""] | int, use: _Use) -> Key[Array, ""]:
    return jax.random.fold_in(jax.random.fold_in(jax.random.wrap_key_data(run_key), generation), use)


def _few(*arguments: Any) -> bool:
    """Return whether this is one run of so small a population that its steps take no time to speak of."""
    config = next(argument for argument in arguments if isinstance(argument, GPConfig))
    return config.runs == 1 and max(config.population, config.num_offspring) <= FEW


def _few_measured(keys: Any, generation: Any, population: Population) -> bool:
    """Return the same without a configuration."""
    return population.fitness.shape[0] == 1 and population.fitness.shape[1] <= FEW


@kept_jit(static_argnames=("config",), small=_few)
def first_trees(keys: RunKeys, alphabet: Alphabet, rates: EditRates, config: GPConfig) -> Trees:
    def one(key: UInt32[Array, "2"]) -> Trees:
        return random_trees(
            _key(key, 0, _Use.FIRST),
            alphabet,
            rates=rates,
            count=config.population,
            num_nodes=config.max_nodes,
            nodes=config.init_nodes,
            gene_under_fallback=config.gene_under_fallback,
        )

    return _for_each_run(one, keys)


@kept_jit(static_argnames=("config",), small=_few)
def offspring_of(
    keys: RunKeys,
    generation: Int32[Array, ""],
    population: Population,
    alphabet: Alphabet,
    rates: EditRates,
    config: GPConfig,
    baseline: Trees | None,
    baseline_fitness: Float32[Array, " R"],
) -> Trees:
    def one(key: UInt32[Array, "2"], parents: Population, fitness: Float32[Array, ""]) -> Trees:
        return reproduce(
            _key(key, generation, _Use.OFFSPRING),
            parents.trees,
            parents.fitness,
            alphabet,
            config,
            rates=rates,
            niche=parents.niche,
            baseline=baseline,
            baseline_fitness=fitness,
        )[0]

    return _for_each_run(one, keys, population, baseline_fitness)


@kept_jit(static_argnames=("config",), small=_few)
def survivors_of(
    keys: RunKeys, generation: Int32[Array, ""], old: Population, offspring: Population, config: GPConfig
) -> Population:
    def one(key: UInt32[Array, "2"], old: Population, offspring: Population) -> Population:
        kept = survivors(
            _key(key, generation, _Use.SURVIVORS), old.fitness, offspring.fitness, config, old.niche, offspring.niche
        )
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b])[kept], old, offspring)

    return _for_each_run(one, keys, old, offspring)


@kept_jit(small=_few_measured)
def diversity_of(
    keys: RunKeys, generation: Int32[Array, ""], population: Population
) -> tuple[Float32[Array, " R"], Float32[Array, " R"]]:
    def one(key: UInt32[Array, "2"], population: Population) -> tuple[Float32[Array, ""], Float32[Array, ""]]:
        distance = mean_edit_distance(_key(key, generation, _Use.DIVERSITY), population.trees)
        return fitness_entropy(population.fitness), distance

    return _for_each_run(one, keys, population)
