"""Ticking whole populations: jump tables, and the walk over them.

A memoryless tree is a jump table: SUCCESS and FAILURE of a leaf each lead to one place, another leaf or the end of the
tick, and RUNNING ends the tick. Control nodes need no visit, since the first leaf of a subtree is the first leaf at or
after its root.

Decorators count over ticks, so that trees with them need a third target and a state. FAILURE leads to the retry around
the subtree that has failed, and RUNNING to the nearest timeout around it; a visit of a decorator compares its count with
its limit. What they have counted by the next tick follows from where this one ends: only the decorators around the node
that is RUNNING remember anything.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Bool, Int8, Int32, UInt8

from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF, Vocabulary
from bt_jax.encoding.arrays import Array, Trees
from bt_jax.encoding.status import Status

__all__ = ["NOTED", "Counters", "JumpTable", "Status", "Ticked", "counters", "jump_table", "tick_trees"]

NOTED = 1 << 3  # in a trace: the leaf had something noted as it ended


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Counters:
    """What the tokens of decorators count."""

    limits: UInt8[Array, " V"]  # up to what; 0 for other tokens
    are_timeouts: Bool[Array, " V"]  # they count RUNNING, retries FAILURE


def counters(vocabulary: Vocabulary) -> Counters | None:
    """Return what the decorators of a vocabulary count, None where it has none."""
    return Counters(vocabulary.limits, vocabulary.kinds == Kind.TIMEOUT) if vocabulary.decorators else None


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class JumpTable:
    """Where a tick goes from each leaf. A word holds `token << 16 | on_success << 8 | on_failure`, so that a visit is one
    look-up; the target N means that the tree has succeeded, N + 1 that it has failed.

    Where there are decorators, a second word holds `end << 17 | is_timeout << 16 | limit << 8 | on_running`; the limit is 0
    where no decorator stands, and the target N + 2 means that the tree is RUNNING.
    """

    words: Int32[Array, "P N"]
    first: UInt8[Array, " P"]  # the leaf where a tick starts
    counting: Int32[Array, "P N"] | None = None


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Ticked:
    """The end of one tick."""

    status: Int8[Array, " E"]  # of the root
    leaf: Int32[Array, " E"]  # node that is RUNNING; N or N + 1 where the tree has succeeded or failed
    noted: Int32[Array, " E"]  # what the leaves that were ticked say above their status, joined bit by bit
    trace: UInt8[Array, "E N"] | None  # where asked for: 1 << status of each leaf that was ticked, and `NOTED`
    counts: UInt8[Array, "E N"] | None = None  # of decorators, for the next tick
    idle: Bool[Array, " E"] | None = None  # where there are decorators: whether a retry is RUNNING while no leaf is

    @property
    def acts(self) -> Bool[Array, " E"]:
        """Whether a leaf is RUNNING; not where a retry is that has only put its child's FAILURE off."""
        running = self.status == Status.RUNNING
        return running if self.idle is None else running & ~self.idle

    @property
    def visited(self) -> Bool[Array, "E N"] | None:
        """The leaves that were ticked, where a trace was asked for."""
        return None if self.trace is None else self.trace > 0


# Of the walk: the node of each E, whether it is RUNNING, what was noted, and the trace.
Carry = tuple[jax.Array, jax.Array, jax.Array, jax.Array | None]
STATUS = 3  # the bits of what a leaf says that are its status


def jump_table(trees: Trees, counts: Counters | None = None) -> JumpTable:
    """Build the tables of P trees [P, N], with decorators if the vocabulary has any."""
    return _memoryless_table(trees) if counts is None else _counting_table(trees, counts)


def _memoryless_table(trees: Trees) -> JumpTable:
    """Build tables in one pass forward and one backward over the nodes of all trees.

    After node i comes the node at its end, e = i + size. It is ticked if the status of i is the one that its parent goes
    on with (SUCCESS in a Sequence, FAILURE in a Fallback); otherwise the parent is done, with that status, and the same
    question is asked at the parent's end.
    """
    small = jnp.int16
    tokens, sizes = (jnp.asarray(x, small).T for x in (trees.tokens, trees.sizes))  # [N, P]: rows are contiguous
    num_nodes, population = tokens.shape
    columns = jnp.arange(population, dtype=jnp.int32)
    root = sizes[0].astype(jnp.int32)
    longest = root.max()
    end = jnp.arange(num_nodes, dtype=small)[:, None] + sizes

    def forward(
        i: jax.Array, parent: jax.Array
    ) -> jax.Array:  # parent[j] = parent's end << 2 | parent's kind, for nodes up to i
        here, is_control = parent[i], tokens[i] < FIRST_LEAF
        last = end[i] >= here >> 2
        after = jnp.where(is_control & ~last, end[i], num_nodes + 1).astype(jnp.int32)
        parent = parent.at[after, columns].set(here, mode="drop", unique_indices=True)
        following = jnp.where(is_control, end[i] << 2 | tokens[i], jnp.where(last, parent[i + 1], here))
        return parent.at[i + 1].set(following)

    top = (sizes[0] << 2)[None]  # the root has no parent: whatever it returns ends the tick
    parent = jnp.concatenate([top, jnp.zeros((num_nodes, population), small)])
    parent = lax.fori_loop(0, longest, forward, parent)

    # targets[j] = on_success << 8 | on_failure: the leaf to tick, or the end, if the tick comes to node j with a status.
    done = jnp.int32(num_nodes << 8 | num_nodes + 1)

    def backward(k: jax.Array, carry: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        targets, leaf = carry
        j = longest - 1 - k
        inside = j < root
        leaf = jnp.where(inside & (tokens[j] >= FIRST_LEAF), j, leaf)
        kind, beyond = parent[j] & 3, targets[(parent[j] >> 2).astype(jnp.int32), columns].astype(jnp.int32)
        row = jnp.where(kind == Kind.SEQUENCE, leaf << 8 | beyond & 255, beyond)
        row = jnp.where(kind == Kind.FALLBACK, beyond & 0xFF00 | leaf, row)
        return targets.at[j].set(jnp.where(inside, row, done).astype(jnp.uint16)), leaf

    targets = jnp.broadcast_to(done.astype(jnp.uint16), (num_nodes + 1, population))
    first = jnp.full(population, num_nodes, jnp.int32)
    targets, first = lax.fori_loop(0, longest, backward, (targets, first))
    after = targets[jnp.minimum(end, num_nodes).astype(jnp.int32), columns]
    words = tokens.astype(jnp.int32) << 16 | after.astype(jnp.int32)
    return JumpTable(words.T, first.astype(jnp.uint8))


def _counting_table(trees: Trees, counters: Counters) -> JumpTable:
    """Build tables in one pass over the nodes of all trees, parents before children: where each status leads from a node
    follows from its parent, from where that status leads there, and from the next sibling."""
    tokens, sizes = (jnp.asarray(x, jnp.int32).T for x in (trees.tokens, trees.sizes))  # [N, P]: rows are contiguous
    num_nodes, population = tokens.shape
    columns = jnp.arange(population, dtype=jnp.int32)
    here = jnp.arange(num_nodes, dtype=jnp.int32)[:, None]
    limits = jnp.asarray(counters.limits, jnp.int32)[tokens]
    timeouts = jnp.asarray(counters.are_timeouts)[tokens]
    kinds = jnp.where(limits > 0, jnp.where(timeouts, Kind.TIMEOUT, Kind.RETRY), jnp.minimum(tokens, FIRST_LEAF))
    ends = here + sizes
    leaf_after = lax.cummin(jnp.where(kinds == FIRST_LEAF, here, num_nodes), axis=0, reverse=True)
    leaf_after = jnp.concatenate([leaf_after, jnp.full((1, population), num_nodes, jnp.int32)])

    # The row N stands for what is around a tree. `exits` holds on_success << 16 | on_failure << 8 | on_running.
    around = ((kinds, Kind.PAD), (ends, 0))
    kinds, ends = (jnp.concatenate([x, jnp.full((1, population), value, jnp.int32)]) for x, value in around)
    done = jnp.full((num_nodes + 1, population), num_nodes << 16 | num_nodes + 1 << 8 | num_nodes + 2, jnp.int32)

    def forward(i: jax.Array, carry: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        parent, exits = carry
        up = parent[i]
        kind, above, following = kinds[up, columns], exits[up, columns], leaf_after[ends[i], columns]
        goes_on = ends[i] < ends[up, columns]
        on_success = jnp.where(goes_on & (kind == Kind.SEQUENCE), following, above >> 16)
        on_failure = jnp.where(goes_on & (kind == Kind.FALLBACK), following, above >> 8 & 255)
        on_failure = jnp.where(kind == Kind.RETRY, up, on_failure)
        on_running = jnp.where(kind == Kind.TIMEOUT, up, above & 255)
        sibling = jnp.where(goes_on, ends[i], num_nodes + 1)
        parent = parent.at[sibling, columns].set(up, mode="drop", unique_indices=True)
        parent = parent.at[i + 1].set(jnp.where(kinds[i] == FIRST_LEAF, parent[i + 1], i))
        return parent, exits.at[i].set(on_success << 16 | on_failure << 8 | on_running)

    parent = jnp.full((num_nodes + 1, population), num_nodes, jnp.int32)
    _, exits = lax.fori_loop(0, sizes[0].max(), forward, (parent, done))
    words = tokens << 16 | exits[:-1] >> 8
    counting = ends[:-1] << 17 | timeouts.astype(jnp.int32) << 16 | limits << 8 | exits[:-1] & 255
    return JumpTable(words.T, leaf_after[0].astype(jnp.uint8), counting.T)


def tick_trees(
    table: JumpTable,
    outcome_of: Callable[[Int32[Array, " E"]], Int8[Array, " E"] | Int32[Array, " E"]],
    *,
    tree: Int32[Array, " E"] | None = None,
    trace: bool = False,
    counts: UInt8[Array, "E N"] | None = None,
    halted: int = 0,
) -> Ticked:
    """Tick E trees once. `outcome_of` gives what the leaf with a token says, for each of the E: its status, and in the bits
    above what is to be `noted`; `tree[e]` is the row of the table that e ticks (default: E = P, each its own). `trace` also
    returns what each leaf that was ticked has returned.

    `counts` are those of the decorators after the tick before, if the table has decorators (default: 0, a first tick); of
    what a leaf notes that is RUNNING, the bits `halted` do not count if a timeout halts it.
    """
    if table.counting is not None:
        return _tick_counting(table, outcome_of, tree, trace, counts, halted)
    num_nodes = table.words.shape[1]
    rows = jnp.arange(table.words.shape[0]) if tree is None else tree
    flat = table.words.reshape(-1)
    offset = rows * num_nodes

    def visit(carry: Carry) -> Carry:
        at, running, noted, traced = carry
        active = (at < num_nodes) & ~running
        word = flat[offset + jnp.minimum(at, num_nodes - 1)]
        outcome = outcome_of(word >> 16).astype(jnp.int32)
        status = outcome & STATUS
        noted = noted | jnp.where(active, outcome & ~STATUS, 0)
        target = jnp.where(status == Status.SUCCESS, word >> 8 & 255, word & 255)
        running = running | (active & (status == Status.RUNNING))
        if traced is not None:
            told = (outcome & ~STATUS != 0) & (status != Status.RUNNING)
            returned = (1 << status) | jnp.where(told, NOTED, 0)
            here = active[:, None] & (jnp.arange(num_nodes)[None] == at[:, None])
            traced = traced | jnp.where(here, returned[:, None], 0).astype(jnp.uint8)
        return jnp.where(active & ~running, target, at), running, noted, traced

    nowhere = jnp.zeros((rows.shape[0], num_nodes), jnp.uint8) if trace else None
    first, none = jnp.asarray(table.first)[rows].astype(jnp.int32), jnp.zeros(rows.shape, jnp.int32)
    start: Carry = first, jnp.zeros(rows.shape, bool), none, nowhere
    at, running, noted, traced = lax.while_loop(lambda c: jnp.any((c[0] < num_nodes) & ~c[1]), visit, start)
    status = jnp.where(running, Status.RUNNING, jnp.where(at == num_nodes, Status.SUCCESS, Status.FAILURE))
    return Ticked(status.astype(jnp.int8), at, noted, traced)


# Of the walk with decorators: the node of each E, the leaf or retry that is RUNNING, what was noted, and the trace.
CountingCarry = tuple[jax.Array, jax.Array, jax.Array, jax.Array | None]


def _tick_counting(
    table: JumpTable,
    outcome_of: Callable[[Int32[Array, " E"]], Int8[Array, " E"] | Int32[Array, " E"]],
    tree: Int32[Array, " E"] | None,
    trace: bool,
    counts: UInt8[Array, "E N"] | None,
    halted: int,
) -> Ticked:
    num_nodes = table.words.shape[1]
    rows = jnp.arange(table.words.shape[0]) if tree is None else tree
    episodes, here = jnp.arange(rows.shape[0]), jnp.arange(num_nodes)[None]
    before = jnp.zeros((rows.shape[0], num_nodes), jnp.uint8) if counts is None else jnp.asarray(counts)
    assert table.counting is not None
    words, counting = table.words.reshape(-1), table.counting.reshape(-1)
    flat_counts, first_word, first_count = before.reshape(-1), rows * num_nodes, episodes * num_nodes

    def visit(carry: CountingCarry) -> CountingCarry:
        at, running, noted, traced = carry
        active, node = at < num_nodes, jnp.minimum(at, num_nodes - 1)
        word, more = words[first_word + node], counting[first_word + node]
        limit, is_timeout = more >> 8 & 255, more >> 16 & 1 == 1
        is_leaf, spent = limit == 0, flat_counts[first_count + node].astype(jnp.int32) + 1 >= limit
        outcome = outcome_of(jnp.where(is_leaf, word >> 16, 0)).astype(jnp.int32)
        status = jnp.where(is_leaf, outcome & STATUS, jnp.where(spent, Status.FAILURE, Status.RUNNING))
        noted = noted | jnp.where(active & is_leaf, outcome & ~STATUS, 0)
        noted = jnp.where(active & ~is_leaf & is_timeout & spent, noted & ~jnp.int32(halted), noted)
        running = jnp.where(active & ~is_timeout & (status == Status.RUNNING), node, running)
        target = jnp.where(status == Status.SUCCESS, word >> 8, jnp.where(status == Status.FAILURE, word, more)) & 255
        if traced is not None:
            told = (outcome & ~STATUS != 0) & (status != Status.RUNNING)
            returned = (1 << status) | jnp.where(told, NOTED, 0)
            ticked = (active & is_leaf)[:, None] & (here == at[:, None])
            traced = traced | jnp.where(ticked, returned[:, None], 0).astype(jnp.uint8)
        return jnp.where(active, target, at), running, noted, traced

    nowhere = jnp.zeros((rows.shape[0], num_nodes), jnp.uint8) if trace else None
    none = jnp.zeros(rows.shape, jnp.int32)
    start: CountingCarry = jnp.asarray(table.first)[rows].astype(jnp.int32), none, none, nowhere
    at, node, noted, traced = lax.while_loop(lambda c: jnp.any(c[0] < num_nodes), visit, start)
    status = jnp.where(at == num_nodes, Status.SUCCESS, jnp.where(at == num_nodes + 1, Status.FAILURE, Status.RUNNING))
    running = status == Status.RUNNING
    own = table.counting[rows]
    remembers = running[:, None] & (own >> 8 & 255 > 0) & (here <= node[:, None]) & (node[:, None] < own >> 17)
    counted = (own >> 16 & 1 == 1) | (here == node[:, None])
    after = jnp.where(remembers, before + counted.astype(jnp.uint8), jnp.uint8(0))
    idle = running & (counting[first_word + node] >> 8 & 255 > 0)
    return Ticked(status.astype(jnp.int8), jnp.where(running, node, at), noted, traced, after, idle)
