"""No individual twice: hashes of trees, a table of those known, and mutation until every offspring is new."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int32, UInt32

from bt_jax.encoding.arrays import Trees
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import MutationConfig
from bt_jax.gp.mutation import EditRates, mutate_packed
from bt_jax.gp.rng import mix
from bt_jax.gp.splice import pack, unpack

__all__ = ["duplicates", "hash_trees", "make_novel"]

ROUNDS = 64


def hash_trees(trees: Trees) -> UInt32[Array, "P 2"]:
    """Return 64 bits of each of P trees, equal for equal trees."""
    return _hash(pack(trees))


def duplicates(hashes: UInt32[Array, "Q 2"]) -> Bool[Array, " Q"]:
    """Return whether an equal pair of hashes comes before."""
    count = hashes.shape[0]
    rows = jnp.arange(count, dtype=jnp.int32)
    return ~_insert(_empty_table(count), hashes, rows, jnp.ones(count, bool))[1]


def make_novel(
    key: Array,
    offspring: Trees,
    population: Trees,
    alphabet: Alphabet,
    config: MutationConfig,
    *,
    rates: EditRates | None = None,
    steps: Int32[Array, " M"] | None = None,
    rounds: int = ROUNDS,
) -> tuple[Trees, Int32[Array, ""]]:
    """Mutate each of M offspring as often as `steps` says (default: not at all), and further while it equals one of the P
    individuals or an offspring that was finished before.

    Also returns how many are no news after the given number of rounds: normally 0. Mutations are carried out in batches
    of those offspring that need one, so that rare duplicates cost little.
    """
    count, size = offspring.tokens.shape[0], population.tokens.shape[0]
    batch = min(count, max(256, count // 20))
    nodes = pack(offspring)
    hashes = jnp.concatenate([_hash(pack(population)), _hash(nodes)])
    steps = jnp.zeros(count, jnp.int32) if steps is None else steps
    rows = jnp.arange(size + count, dtype=jnp.int32)
    finished = jnp.concatenate([jnp.ones(size, bool), steps == 0])
    table, fresh = _insert(_empty_table(size + count), hashes, rows, finished)
    steps = jnp.where(finished & ~fresh, 1, jnp.pad(steps, (size, 0)))[size:]
    places = 1 + jnp.arange(batch, dtype=jnp.int32)
    limit = config.max_steps * -(-count // batch) + rounds

    def goes_on(state: tuple) -> Array:
        step, steps, *_ = state
        return (step < limit) & jnp.any(steps > 0)

    def mutate_some(state: tuple) -> tuple:
        step, steps, nodes, hashes, table = state
        waiting = jnp.cumsum((steps > 0).astype(jnp.int32))
        index = jnp.searchsorted(waiting, places).astype(jnp.int32)  # `count` where fewer wait
        safe = jnp.minimum(index, count - 1)
        mutated = mutate_packed(key, nodes[safe], alphabet, config, rates=rates, step=step)
        left = steps[safe] - 1
        nodes = nodes.at[index].set(mutated, mode="drop")
        hashes = hashes.at[size + index].set(_hash(mutated), mode="drop")
        finished = (left == 0) & (index < count)
        table, fresh = _insert(table, hashes, size + safe, finished)
        left = jnp.where(finished & ~fresh, 1, left)
        return step + 1, steps.at[index].set(left, mode="drop"), nodes, hashes, table

    state = (jnp.int32(0), steps, nodes, hashes, table)
    _, steps, nodes, *_ = jax.lax.while_loop(goes_on, mutate_some, state)
    return unpack(nodes), jnp.sum((steps > 0).astype(jnp.int32))


def _hash(nodes: Int32[Array, "P N"]) -> UInt32[Array, "P 2"]:
    """Return two sums over the nodes of a tree, each node mixed with its place."""
    places = jnp.arange(nodes.shape[1], dtype=jnp.uint32)[None] * jnp.uint32(0x9E3779B9)
    mixed = mix(nodes.astype(jnp.uint32) ^ places)
    sums = (jnp.sum(jnp.where(nodes != 0, bits, 0), axis=1) for bits in (mixed, mix(mixed + jnp.uint32(0x27D4EB2F))))
    return jnp.stack(list(sums), axis=1)


def _empty_table(rows: int) -> Int32[Array, " T"]:
    """Room for that many rows and as many again, and one entry for those that are not asked about."""
    return jnp.full((1 << (2 * rows - 1).bit_length()) + 1, rows, jnp.int32)


def _insert(
    table: Int32[Array, " T"], hashes: UInt32[Array, "Q 2"], rows: Int32[Array, " C"], asked: Bool[Array, " C"]
) -> tuple[Int32[Array, " T"], Bool[Array, " C"]]:
    """Enter those of the rows (of `hashes`) that are asked about, and say which are new; of equal ones the first is.

    Open addressing with double hashing. Equal hashes probe the same entries, so that they meet where the first one
    settles; an entry, once taken, stays.
    """
    nobody, spare = hashes.shape[0], table.shape[0] - 1
    start, stride = hashes[rows, 0], hashes[rows, 1] | 1

    def probe(state: tuple) -> tuple:
        place, table, open_, fresh = state
        entry = jnp.where(open_, (start + place * stride) & jnp.uint32(spare - 1), spare).astype(jnp.int32)
        claims = open_ & (table[entry] == nobody)
        table = table.at[jnp.where(claims, entry, spare)].min(jnp.where(claims, rows, nobody))
        owner = jnp.minimum(table[entry], nobody - 1)
        fresh |= open_ & (owner == rows)
        open_ &= jnp.any(hashes[owner] != hashes[rows], axis=1)
        return place + 1, table, open_, fresh

    state = (jnp.uint32(0), table, asked, jnp.zeros_like(asked))
    _, table, _, fresh = jax.lax.while_loop(lambda state: jnp.any(state[2]), probe, state)
    return table, fresh
