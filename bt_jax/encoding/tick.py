"""Ticking whole populations: jump tables, and the walk over them.

A memoryless tree is a jump table: SUCCESS and FAILURE of a leaf each lead to one place, another leaf or the end of the
tick, and RUNNING ends the tick. Control nodes need no visit, since the first leaf of a subtree is the first leaf at or
after its root.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Bool, Int8, Int32, UInt8

from bt_jax.behaviors.nodes import Kind
from bt_jax.behaviors.vocabulary import FIRST_LEAF
from bt_jax.encoding.arrays import Array, Trees
from bt_jax.encoding.status import Status

__all__ = ["NOTED", "JumpTable", "Status", "Ticked", "jump_table", "tick_trees"]

NOTED = 1 << 3  # in a trace: the leaf had something noted as it ended


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class JumpTable:
    """Where a tick goes from each leaf. A word holds `token << 16 | on_success << 8 | on_failure`, so that a visit is one
    look-up; the target N means that the tree has succeeded, N + 1 that it has failed."""

    words: Int32[Array, "P N"]
    first: UInt8[Array, " P"]  # the leaf where a tick starts


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Ticked:
    """The end of one tick."""

    status: Int8[Array, " E"]  # of the root
    leaf: Int32[Array, " E"]  # node that is RUNNING; N or N + 1 where the tree has succeeded or failed
    noted: Int32[Array, " E"]  # what the leaves that were ticked say above their status, joined bit by bit
    trace: UInt8[Array, "E N"] | None  # where asked for: 1 << status of each leaf that was ticked, and `NOTED`

    @property
    def visited(self) -> Bool[Array, "E N"] | None:
        """The leaves that were ticked, where a trace was asked for."""
        return None if self.trace is None else self.trace > 0


# Of the walk: the node of each E, whether it is RUNNING, what was noted, and the trace.
Carry = tuple[jax.Array, jax.Array, jax.Array, jax.Array | None]
STATUS = 3  # the bits of what a leaf says that are its status


def jump_table(trees: Trees) -> JumpTable:
    """Build the tables of P trees [P, N], in one pass forward and one backward over their nodes.

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


def tick_trees(
    table: JumpTable,
    outcome_of: Callable[[Int32[Array, " E"]], Int8[Array, " E"] | Int32[Array, " E"]],
    *,
    tree: Int32[Array, " E"] | None = None,
    trace: bool = False,
) -> Ticked:
    """Tick E trees once. `outcome_of` gives what the leaf with a token says, for each of the E: its status, and in the bits
    above what is to be `noted`; `tree[e]` is the row of the table that e ticks (default: E = P, each its own). `trace` also
    returns what each leaf that was ticked has returned."""
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
