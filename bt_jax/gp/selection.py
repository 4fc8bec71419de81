"""Who becomes a parent, and who survives. Every method maps a key and the fitness of P individuals to indices."""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float32, Int32

from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.diversity import fitness_entropy
from bt_jax.gp.rng import shuffled

__all__ = [
    "adjustable_rank",
    "elitism",
    "everyone",
    "niche_strength",
    "rank",
    "select",
    "survivors",
    "tournament",
    "uniform",
]

Fitness = Float32[Array, " P"]
Indices = Int32[Array, " num"]


def tournament(key: Array, fitness: Fitness, num: int) -> Indices:
    """The `num` winners of a knock-out: in the shuffled field, with byes to num * 2^m, pairs meet and the better stays.

    The rounds of one final bracket of 2^m come down to its best member, the first of equals. Distinct winners.
    """
    count = fitness.shape[0]
    if num == 0:
        return jnp.zeros(0, jnp.int32)
    rounds = max(-(-count // num) - 1, 0).bit_length()
    field = shuffled(key, count)
    byes = (num << rounds) - count
    field = jnp.pad(field, (0, byes)).reshape(-1, num)
    strength = jnp.where(jnp.arange(num << rounds).reshape(-1, num) < count, fitness[field], -jnp.inf)
    best = jnp.argmax(strength, axis=0)
    return jnp.take_along_axis(field, best[None], axis=0)[0]


def rank(key: Array, fitness: Fitness, num: int) -> Indices:
    """Draw without replacement, in proportion to the rank: P for the best, 1 for the worst."""
    return _by_weight(key, _ranks(fitness) + 1, num)


def adjustable_rank(key: Array, fitness: Fitness, num: int) -> Indices:
    """Draw without replacement, by linear ranking (Baker 1985) with pressure 1 + diversity: the best is that many times
    as likely as the average. Diversity is the entropy of the fitness over its largest value, log P; a population of
    equals is drawn from evenly, which lets it drift apart."""
    count = fitness.shape[0]
    pressure = 1 + fitness_entropy(fitness) / jnp.log(jnp.float32(count))
    weights = 2 - pressure + 2 * (pressure - 1) * _ranks(fitness) / (count - 1)
    return _by_weight(key, weights, num)


def elitism(key: Array, fitness: Fitness, num: int) -> Indices:
    """Return the best, in order; the first of equals comes first."""
    del key
    return jax.lax.top_k(fitness, num)[1]


def uniform(key: Array, fitness: Fitness, num: int) -> Indices:
    """Draw without replacement, evenly."""
    return shuffled(key, fitness.shape[0])[:num]


def everyone(key: Array, fitness: Fitness, num: int) -> Indices:
    """Return all in their order, again from the first where `num` is more than there are."""
    del key
    return jnp.arange(num, dtype=jnp.int32) % fitness.shape[0]


METHODS = {
    Selection.TOURNAMENT: tournament,
    Selection.RANK: rank,
    Selection.ADJUSTABLE_RANK: adjustable_rank,
    Selection.ELITISM: elitism,
    Selection.RANDOM: uniform,
    Selection.ALL: everyone,
}


def select(method: Selection, key: Array, fitness: Fitness, num: int) -> Indices:
    """`num` individuals (at most P, but for `ALL`) by one of the methods; no index twice (but for `ALL`)."""
    return METHODS[method](key, fitness, num)


@partial(jax.jit, static_argnames="config")
def survivors(
    key: Array,
    fitness: Fitness,
    offspring_fitness: Float32[Array, " M"],
    config: GPConfig,
    niche: Int32[Array, " P"] | None = None,
    offspring_niche: Int32[Array, " M"] | None = None,
) -> Int32[Array, " P"]:
    """Return the next population, as indices into the old one followed by the offspring; elites first.

    The best `config.old_share` of the old population and all offspring compete; the best of these are elites, the other
    places are filled from the rest by `config.survivor_selection`. Where niches are given, `niche_strength` takes the place
    of the fitness.
    """
    count = fitness.shape[0]
    if niche is not None and offspring_niche is not None:
        strength = niche_strength(
            jnp.concatenate([fitness, offspring_fitness]), jnp.concatenate([niche, offspring_niche])
        )
        fitness, offspring_fitness = strength[:count], strength[count:]
    old = jnp.arange(count, dtype=jnp.int32)
    if config.num_old_survivors < count:
        old = jax.lax.top_k(fitness, config.num_old_survivors)[1]
    pool = jnp.concatenate([old, count + jnp.arange(offspring_fitness.shape[0], dtype=jnp.int32)])
    strength = jnp.concatenate([fitness[old], offspring_fitness])
    elites = jax.lax.top_k(strength, config.num_elites)[1]
    is_elite = jnp.zeros(pool.shape[0], bool).at[elites].set(True)
    rest = jnp.nonzero(~is_elite, size=pool.shape[0] - config.num_elites)[0].astype(jnp.int32)
    others = rest[select(config.survivor_selection, key, strength[rest], count - config.num_elites)]
    return pool[jnp.concatenate([elites, others])]


def niche_strength(fitness: Fitness, niche: Int32[Array, " P"]) -> Fitness:
    """Return what selection sees in place of the fitness where individuals have niches: their place, P - 1 for the first.

    The best of every niche come first, then the second best of every niche, and so on; those of one turn are ordered by
    fitness. So each niche gets as many places as the others, as far as it can fill them (after clearing with a capacity,
    Petrowski 1996). In a niche, individuals of equal fitness, which most likely do the same, wait until all other fitness
    values had their turn; the last of them goes first, so that offspring replace their equals and a niche that gains
    nothing drifts on. -inf stays.
    """
    places = jnp.arange(fitness.shape[0], dtype=jnp.int32)
    copy = _turns(jnp.lexsort((-places, fitness, niche)), niche, fitness)
    turn = _turns(jnp.lexsort((-fitness, copy, niche)), niche)
    strength = jnp.zeros_like(fitness).at[jnp.lexsort((fitness, -turn))].set(places.astype(fitness.dtype))
    return jnp.where(fitness == -jnp.inf, -jnp.inf, strength)


def _turns(order: Indices, *labels: Array) -> Indices:
    """For each individual, how many of the same labels come before it in an order that keeps those together."""
    places = jnp.arange(order.shape[0], dtype=jnp.int32)
    begins = places == 0
    for label in labels:
        begins |= jnp.append(True, label[order][1:] != label[order][:-1])
    return jnp.zeros_like(places).at[order].set(places - jax.lax.cummax(jnp.where(begins, places, 0)))


def _ranks(fitness: Fitness) -> Fitness:
    """0 for the worst to P - 1 for the best; equals share the middle of their ranks."""
    ordered = jnp.sort(fitness)
    below, up_to = (jnp.searchsorted(ordered, fitness, side=side) for side in ("left", "right"))
    return (below + up_to - 1).astype(jnp.float32) / 2


def _by_weight(key: Array, weights: Fitness, num: int) -> Indices:
    """Draw without replacement in proportion to weights, by the Gumbel trick."""
    noisy = jnp.log(weights) + jax.random.gumbel(key, weights.shape)
    return jax.lax.top_k(noisy, num)[1]
