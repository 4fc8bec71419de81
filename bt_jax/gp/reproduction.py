"""One generation of offspring."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float32, Int32

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import GPConfig
from bt_jax.gp.crossover import crossover
from bt_jax.gp.mutation import EditRates, chain_lengths
from bt_jax.gp.novelty import make_novel
from bt_jax.gp.rng import shuffled
from bt_jax.gp.selection import niche_strength, select

__all__ = ["reproduce"]

BASELINE_NICHE = -1  # of its own


def reproduce(
    key: Array,
    population: Trees,
    fitness: Float32[Array, " P"],
    alphabet: Alphabet,
    config: GPConfig,
    *,
    rates: EditRates | None = None,
    niche: Int32[Array, " P"] | None = None,
    baseline: Trees | None = None,
    baseline_fitness: Float32[Array, ""] | None = None,
) -> tuple[Trees, Int32[Array, ""]]:
    """Return M offspring of P individuals, and how many of them are not new (normally 0).

    The first `num_mutation_parents * mutation_offspring` come from chains of mutations, the others from crossover. A
    `baseline` (one tree, arrays of length N) is added to the individuals that may become parents where they lack it
    (`baseline_keep`), with `baseline_fitness` (default: the worst); `baseline_boost` makes it the best when the parents of
    crossover are chosen. Where individuals have a niche, parents are selected by `niche_strength` in place of fitness. Apply
    `jax.vmap` over key, population, fitness and niche for independent runs. A traced alphabet needs its `rates`.
    """
    rates = EditRates.of(alphabet, config.mutation) if rates is None else rates
    return _reproduced(key, population, fitness, alphabet, rates, config, niche, baseline, baseline_fitness)


@partial(jax.jit, static_argnames="config")
def _reproduced(
    key: Array,
    population: Trees,
    fitness: Float32[Array, " P"],
    alphabet: Alphabet,
    rates: EditRates,
    config: GPConfig,
    niche: Int32[Array, " P"] | None,
    baseline: Trees | None,
    baseline_fitness: Float32[Array, ""] | None,
) -> tuple[Trees, Int32[Array, ""]]:
    mutation_key, chain_key, cross_key, pair_key, crossing_key, novel_key = jax.random.split(key, 6)
    known = population
    if baseline is not None and config.baseline_keep:
        if baseline_fitness is None:
            baseline_fitness = jnp.min(fitness)
        lost = ~jnp.any(_is(baseline, population))
        known = jax.tree.map(lambda all_, one: jnp.concatenate([all_, one[None]]), population, baseline)
        fitness = jnp.append(fitness, jnp.where(lost, baseline_fitness, -jnp.inf))
        niche = None if niche is None else jnp.append(niche, BASELINE_NICHE)
    if niche is not None:
        fitness = niche_strength(fitness, niche)

    parents = select(config.parent_selection, mutation_key, fitness, config.num_mutation_parents)
    parents = jnp.tile(parents, config.mutation_offspring)
    offspring, steps = [known[parents]], chain_lengths(chain_key, parents.shape[0], config.mutation)

    if config.num_crossover_parents:
        if baseline is not None and config.baseline_boost:
            boosted = _is(baseline, known) & (fitness > -jnp.inf)
            fitness = jnp.where(boosted, jnp.inf, fitness)
        parents = select(config.parent_selection, cross_key, fitness, config.num_crossover_parents)
        passes = [shuffled(pair_key, parents.shape[0], i) for i in range(config.crossover_offspring)]
        pairs = jnp.concatenate([parents[order].reshape(2, -1) for order in passes], axis=1)
        a, b = known[pairs[0]], known[pairs[1]]
        offspring += crossover(
            crossing_key,
            a,
            b,
            alphabet,
            gene_under_fallback=config.gene_under_fallback,
            swap=config.crossover_swap,
            baseline=None if baseline is None else jnp.stack([_is(baseline, a), _is(baseline, b)]),
            baseline_index=config.baseline_index,
        )
    together = jax.tree.map(lambda *parts: jnp.concatenate(parts), *offspring)
    steps = jnp.pad(steps, (0, together.tokens.shape[0] - steps.shape[0]))
    return make_novel(novel_key, together, known, alphabet, config.mutation, rates=rates, steps=steps)


def _is(baseline: Trees, trees: Trees) -> Array:
    same = (trees.tokens == baseline.tokens[None]) & (trees.sizes == baseline.sizes[None])
    return jnp.all(same, axis=1)
