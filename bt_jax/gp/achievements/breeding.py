"""Offspring of the search: trees that test leaves, that are assembled from what is known, that get what they lack, that are
refined or hardened, and the crossovers and mutations of the other method."""

from __future__ import annotations

import enum

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int8, Int32, UInt32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Trees
from bt_jax.gp.achievements.compose import children_of, compose, leaf_parts
from bt_jax.gp.achievements.goals import Goals
from bt_jax.gp.achievements.knowledge import Knowledge
from bt_jax.gp.achievements.traces import without_leaf
from bt_jax.gp.alphabet import Alphabet
from bt_jax.gp.config import MutationConfig
from bt_jax.gp.crossover import crossover
from bt_jax.gp.mutation import EditRates, mutate_packed
from bt_jax.gp.novelty import hash_trees
from bt_jax.gp.splice import pack, unpack
from bt_jax.gp.validity import is_valid

__all__ = ["Origin", "built", "origins", "varied"]

NEW = 0.5  # share of trees that test leaves, while there is something to test
HARDENS = 0.3  # share of all others, where there are decorators
SHARES = (0.27, 0.36, 0.1, 0.135)  # of the others, from `ASSEMBLED` to `CROSSED`; the rest are `MUTATED`
WITH_STEP = 0.7  # of assembled trees begin with what has done a step on the way
GUARDED = 0.5  # of new trees, while nobody has done a step
CURIOUS = 0.25  # of assembled and filled trees test a leaf in place of one that is known
IN_PLACE = 0.5  # of filled trees in which another leaf of the group stands lose that one
SHORTER = 0.3  # of refined trees that lack nothing lose a leaf
DRAWS = 4  # of what has done a step, the smallest of so many is taken


class Origin(enum.IntEnum):
    """How an offspring is made."""

    TESTING = 0
    ASSEMBLED = 1
    FILLED = 2
    REFINED = 3
    CROSSED = 4
    MUTATED = 5
    HARDENED = 6


def origins(
    rng: np.random.Generator, knowledge: Knowledge, goals: Goals, count: int, *, hardens: bool = False
) -> Int32[np.ndarray, " M"]:
    """Draw how each of M offspring is made."""
    if not len(knowledge.archive):
        return np.full(count, Origin.TESTING, np.int32)
    testing = NEW if knowledge.linkage.untested(goals) or knowledge.missing_steps(goals).size else 0.0
    other = 1 + (rng.random(count)[:, None] >= np.cumsum(SHARES)).sum(axis=1)
    if hardens:
        other = np.where(rng.random(count) < HARDENS, Origin.HARDENED, other)
    return np.where(rng.random(count) < testing, Origin.TESTING, other).astype(np.int32)


def built(
    rng: np.random.Generator,
    origin: Int32[np.ndarray, " M"],
    parents: Trees,
    achieved: Bool[np.ndarray, "M A"],
    missed: Float32[np.ndarray, "M A"],
    knowledge: Knowledge,
    goals: Goals,
    kinds: Int8[np.ndarray, " V"],
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return M trees [M, N], those that are put together as their origins say, and which of them came about. Where nothing
    is lacking that could be filled in, a parent is refined. `achieved` and `missed` are those of the parents."""
    trees = Trees(np.zeros_like(parents.tokens), np.zeros_like(parents.sizes))
    made = np.zeros(len(origin), bool)
    origin = np.where((origin == Origin.FILLED) & achieved.all(axis=1), Origin.REFINED, origin)
    for kind, make in (
        (Origin.TESTING, lambda rows: _testing(rng, len(rows), knowledge, goals, trees.num_nodes)),
        (Origin.ASSEMBLED, lambda rows: _assembled(rng, len(rows), knowledge, goals, trees.num_nodes)),
        (Origin.FILLED, lambda rows: _filled(rng, parents[rows], achieved[rows], knowledge, goals)),
        (Origin.REFINED, lambda rows: _refined(rng, parents[rows], achieved[rows], missed[rows], goals, kinds)),
    ):
        rows = np.flatnonzero(origin == kind)
        if rows.size:
            some, made[rows] = make(rows)
            trees.tokens[rows], trees.sizes[rows] = some.tokens, some.sizes
    return trees, made


def _testing(
    rng: np.random.Generator, count: int, knowledge: Knowledge, goals: Goals, num_nodes: int
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return Sequences of one leaf of each group, the least tested, in random order; some under a guard."""
    groups = np.arange(goals.num_groups, dtype=np.int32)
    leaves = rng.permuted(knowledge.linkage.least_tested(rng, groups, goals, count), axis=1)
    trees, made = compose(leaf_parts(leaves, num_nodes))
    missing = knowledge.missing_steps(goals)
    if missing.size:
        guard = np.where(rng.random(count) < GUARDED, goals.guard[rng.choice(missing, count)], 0)
        trees, fits = _under_guard(trees, guard.astype(np.int32))
        made &= fits
    return trees, made


def _under_guard(trees: Trees, guard: Int32[np.ndarray, " M"]) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return Fallbacks of a guard and the tree, which is then ticked only until the guard holds; 0 is no guard."""
    guards = leaf_parts(guard[:, None], trees.num_nodes)
    parts = Trees(
        np.concatenate([guards.tokens, trees.tokens[:, None]], axis=1),
        np.concatenate([guards.sizes, trees.sizes[:, None]], axis=1),
    )
    return compose(parts, Kind.FALLBACK)


def _assembled(
    rng: np.random.Generator, count: int, knowledge: Knowledge, goals: Goals, num_nodes: int
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return Sequences of a leaf for each target, in an order that has worked, many of them behind what has done the steps
    on the way."""
    targets = np.flatnonzero(goals.concerns >= 0)
    curious = np.where(rng.random(count) < CURIOUS, rng.integers(max(len(targets), 1), size=count), -1)
    drawn = [knowledge.linkage.donors(rng, int(t), goals, curious == i) for i, t in enumerate(targets)]
    leaves = np.stack(drawn, axis=1) if drawn else np.zeros((count, 0), np.int32)
    leaves = knowledge.linkage.in_order(rng, leaves)
    parts = [leaf_parts(leaves, num_nodes)]
    for step in np.flatnonzero(goals.concerns < 0):
        front = _step_donors(rng, int(step), knowledge, goals, count)
        if front is not None:
            absent = rng.random(count) >= WITH_STEP
            front.tokens[absent], front.sizes[absent] = 0, 0
            parts.insert(0, Trees(front.tokens[:, None], front.sizes[:, None]))
    return compose(_beside(parts))


def _beside(parts: list[Trees]) -> Trees:
    return Trees(
        *(np.concatenate(fields, axis=1) for fields in zip(*((p.tokens, p.sizes) for p in parts), strict=True))
    )


def _step_donors(rng: np.random.Generator, step: int, knowledge: Knowledge, goals: Goals, count: int) -> Trees | None:
    """Return for `count` trees what has done a step on the way: a leaf, if one has done it, or else of a tree in the archive
    the Fallback that begins with the step's guard, or the whole tree under such a guard. None if no tree has done it."""
    leaves = knowledge.linkage.step_leaves(rng, step, count)
    if leaves is not None:
        return leaf_parts(leaves, knowledge.archive.trees.num_nodes)
    archive = knowledge.archive
    entries = np.flatnonzero(archive.achieved(len(goals.concerns))[:, step])
    if not entries.size:
        return None
    drawn = entries[rng.integers(len(entries), size=(count, DRAWS))]
    donors, fits = _guarded_part(archive.trees[drawn.reshape(-1)], int(goals.guard[step]))
    size = np.where(fits, donors.sizes[:, 0].astype(np.int64), 1 << 16).reshape(count, DRAWS)
    donors = donors[np.arange(count) * DRAWS + size.argmin(axis=1)]
    return Trees(donors.tokens.copy(), donors.sizes.copy())


def _guarded_part(trees: Trees, guard: int) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    count, num_nodes = trees.tokens.shape
    if not guard:
        return trees, np.ones(count, bool)
    starts = (trees.tokens[:, :-1] == Kind.FALLBACK) & (trees.tokens[:, 1:] == guard)
    has, at = starts.any(axis=1), starts.argmax(axis=1)
    whole, fits = _under_guard(trees, np.where(has, 0, guard).astype(np.int32))
    rows, here = np.arange(count)[:, None], np.arange(num_nodes)
    inside = here < trees.sizes[rows, at[:, None]]
    source = np.minimum(at[:, None] + here, num_nodes - 1)
    tokens = np.where(inside, trees.tokens[rows, source], 0)
    sizes = np.where(inside, trees.sizes[rows, source], 0)
    has = has[:, None]
    return Trees(np.where(has, tokens, whole.tokens), np.where(has, sizes, whole.sizes)), fits


def _filled(
    rng: np.random.Generator,
    receivers: Trees,
    achieved: Bool[np.ndarray, "M A"],
    knowledge: Knowledge,
    goals: Goals,
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return the receivers with something for what each lacks: for a target a leaf, in place of one of the same group or
    anywhere among the children of the root; for a step on the way what has done it, in front, or a guard around all."""
    lacks = np.where(achieved, -1.0, rng.random(achieved.shape))
    wanted, made = lacks.argmax(axis=1), np.array(~achieved.all(axis=1))
    trees = Trees(receivers.tokens.copy(), receivers.sizes.copy())
    for achievement in np.unique(wanted[made]):
        rows = np.flatnonzero(made & (wanted == achievement))
        if goals.concerns[achievement] >= 0:
            leaves = knowledge.linkage.donors(rng, int(achievement), goals, rng.random(rows.size) < CURIOUS)
            some, fits = _with_leaf(rng, receivers[rows], leaves, goals)
        else:
            front = _step_donors(rng, int(achievement), knowledge, goals, rows.size)
            if front is None:
                guard = np.full(rows.size, goals.guard[achievement], np.int32)
                some, fits = _under_guard(receivers[rows], guard)
            else:
                rest = children_of(receivers[rows])
                some, fits = compose(_beside([Trees(front.tokens[:, None], front.sizes[:, None]), rest]))
        trees.tokens[rows], trees.sizes[rows], made[rows] = some.tokens, some.sizes, fits
    return trees, made


def _refined(
    rng: np.random.Generator,
    parents: Trees,
    achieved: Bool[np.ndarray, "M A"],
    missed: Float32[np.ndarray, "M A"],
    goals: Goals,
    kinds: Int8[np.ndarray, " V"],
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return the parents, each with one leaf replaced by another of its group. In a tree that achieves everything, a leaf is
    chosen in proportion to the fitness that its group costs, and some of these trees lose a leaf instead."""
    tokens, sizes = parents.tokens.copy(), parents.sizes.copy()
    leaf = (tokens >= FIRST_LEAF) & (goals.group[tokens] >= 0)
    group = np.where(leaf, goals.group[tokens], 0)
    complete = np.array(achieved.all(axis=1))
    cost = missed @ (goals.concerns[:, None] == np.arange(goals.num_groups))  # [M, G]
    weight = leaf * np.where(complete[:, None], np.take_along_axis(cost, group, axis=1), np.float32(1))
    made = np.array(weight.any(axis=1))
    with np.errstate(divide="ignore"):
        at = (rng.exponential(size=weight.shape) / weight).argmin(axis=1)
    shorter = complete & (rng.random(len(tokens)) < SHORTER)
    for row in np.flatnonzero(made & ~shorter):
        alike = np.flatnonzero(goals.group == group[row, at[row]])
        tokens[row, at[row]] = alike[rng.integers(alike.size)]
    for row in np.flatnonzero(shorter):
        smaller = without_leaf(parents[row], int(rng.choice(np.flatnonzero(tokens[row] >= FIRST_LEAF))), kinds)
        made[row] = smaller is not None
        if smaller is not None:
            tokens[row], sizes[row] = smaller.tokens, smaller.sizes
    return Trees(tokens, sizes), made


def _with_leaf(
    rng: np.random.Generator, receivers: Trees, leaves: Int32[np.ndarray, " M"], goals: Goals
) -> tuple[Trees, Bool[np.ndarray, " M"]]:
    """Return each receiver with a leaf in place of one of its group, or inserted among the children of its root."""
    count, num_nodes = receivers.tokens.shape
    rows = np.arange(count)
    tokens = receivers.tokens
    alike = (tokens >= FIRST_LEAF) & (goals.group[tokens] == goals.group[leaves][:, None])
    alike &= tokens != leaves[:, None]
    at = np.where(alike, rng.random(alike.shape), -1.0).argmax(axis=1)
    in_place = alike.any(axis=1) & (rng.random(count) < IN_PLACE)
    swapped = Trees(tokens.copy(), receivers.sizes.copy())
    swapped.tokens[rows[in_place], at[in_place]] = leaves[in_place]

    parts = children_of(receivers)
    children = (parts.sizes[..., 0] > 0).sum(axis=1)
    place = (rng.random(count) * (children + 1)).astype(np.int64)
    source = np.arange(parts.sizes.shape[1] + 1)[None]
    source = np.where(source > place[:, None], source - 1, np.where(source == place[:, None], -1, source))
    lone = leaf_parts(leaves[:, None], num_nodes)
    together = Trees(
        np.concatenate([parts.tokens, lone.tokens], axis=1), np.concatenate([parts.sizes, lone.sizes], axis=1)
    )
    inserted, fits = compose(together[rows[:, None], source])
    chosen = in_place[:, None]
    trees = Trees(np.where(chosen, swapped.tokens, inserted.tokens), np.where(chosen, swapped.sizes, inserted.sizes))
    return trees, (fits | in_place) & (leaves > 0)


@kept_jit(static_argnames=("config",), small=lambda *arguments: arguments[1].tokens.shape[0] <= 64)
def varied(
    key: UInt32[Array, "2"],
    first: Trees,
    second: Trees,
    put_together: Trees,
    origin: Int32[Array, " M"],
    steps: Int32[Array, " M"],
    alphabet: Alphabet,
    rates: EditRates,
    config: MutationConfig,
) -> tuple[Trees, Bool[Array, " M"], UInt32[Array, "M 2"]]:
    """Return M offspring of the origins, each mutated as often as `steps` says, which of them are valid, and their hashes.
    The first parents are mutated, or crossed with the second."""
    cross_key, mutation_key = jax.random.split(jax.random.wrap_key_data(key))
    crossed, _ = crossover(cross_key, first, second, alphabet, gene_under_fallback=config.gene_under_fallback)
    sources = {Origin.CROSSED: pack(crossed), Origin.MUTATED: pack(first)}
    nodes = pack(put_together)
    for kind, source in sources.items():
        nodes = jnp.where((origin == kind)[:, None], source, nodes)

    def body(step: Array, nodes: Array) -> Array:
        mutated = mutate_packed(mutation_key, nodes, alphabet, config, rates=rates, step=step)
        return jnp.where((step < steps)[:, None], mutated, nodes)

    trees = unpack(jax.lax.fori_loop(0, jnp.max(steps), body, nodes))
    return trees, is_valid(trees, alphabet, gene_under_fallback=config.gene_under_fallback), hash_trees(trees)
