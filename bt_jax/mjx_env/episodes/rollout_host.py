"""Rollouts whose physics are on the host, the C engine with its threads among them."""

from __future__ import annotations

import operator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, Status, Ticked, jump_table, tick_trees
from bt_jax.mjx_env.episodes.rules import Ending, Tally, count_tick, fresh_tally, resolve, used_up
from bt_jax.mjx_env.faults.fates import Fates, between_ticks, carry_out, something_happens
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.outcomes import command_of, subgoals_of
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import reach, settled_world
from bt_jax.mjx_env.world import Array, World, take

__all__ = ["HostRollout"]
ROWS = 4096  # episodes that run together
BUCKETS = (64, 512, ROWS)
FEW_TOKENS = 256  # of a vocabulary whose leaves are all computed
COLUMNS = 64  # of outcomes, or a multiple: few shapes are compiled


class HostRollout:
    """Runs episodes in a loop over ticks, all of them together; those that have ended leave the batch.

    The physics get the problems of a tick as one batch, each reduced to its neighbourhood (see `Settler`).
    """

    def __init__(self, semantics: LeafSemantics, physics: Physics, *, trace: bool = False) -> None:
        self.semantics, self.trace = semantics, trace
        self.settler, self._variants = Settler(semantics.task, physics), Variants(semantics)

    def __call__(
        self, trees: Trees, tree: Int32[np.ndarray, " E"], start: World, fates: Fates | None = None
    ) -> tuple[World, Tally]:
        """Return states and tally (NumPy) at the ends of E episodes: trees `tree` from states `start`."""
        look_up = _LookUp(self.semantics, trees)
        fresh = fresh_tally(tree.size, trace_nodes=trees.num_nodes if self.trace else None)
        ends = jax.tree.map(np.array, (start, fresh))
        for first in range(0, tree.size, ROWS):
            rows = np.arange(first, min(first + ROWS, tree.size))
            while rows.size:
                world, tally = jax.tree.map(operator.itemgetter(rows), ends)
                after = self._tick(look_up, tree[rows], world, tally, None if fates is None else fates[rows])
                for every, new in zip(jax.tree.leaves(ends), jax.tree.leaves(after), strict=True):
                    every[rows] = new
                rows = rows[after[1].ending == Ending.OPEN]
        return ends

    def _tick(
        self, look_up: _LookUp, tree: Int32[np.ndarray, " n"], world: World, tally: Tally, fates: Fates | None
    ) -> tuple[World, Tally]:
        """Return states and tally one tick later."""
        semantics = self.semantics
        rules = semantics.task.episode
        ticked = look_up.tick(tree, world, used_up(tally, rules), trace=self.trace)
        command, broken = command_of(ticked.noted), np.zeros(tree.size, bool)
        world = reach(world, subgoals_of(ticked.noted))
        running = np.flatnonzero(ticked.status == Status.RUNNING)
        if running.size:
            own, tick = None if fates is None else fates[running], tally.ticks[running]
            released = carry_out(self._variants, take(world, running), command[running], own, tick)
            poses, ok = self.settler.settle(released)
            broken[running] = ~ok
            world = _replaced(world, running[ok], settled_world(semantics.task, released, poses), ok)
        after = count_tick(tally, ticked.status, command, broken, rules, ticked.trace)
        if fates is not None:
            rows = np.flatnonzero((after.ending == Ending.OPEN) & something_happens(fates, tally.ticks))
            world = _replaced(
                world, rows, between_ticks(take(world, rows), semantics.task, fates[rows], tally.ticks[rows])
            )
        return world, after


def _replaced(
    world: World, rows: Int[np.ndarray, " n"], new: World, chosen: Bool[np.ndarray, " m"] | slice = slice(None)
) -> World:
    """Return the states with those at `rows` replaced by the `chosen` ones of new states."""
    world = jax.tree.map(np.array, world)
    for every, some in zip(jax.tree.leaves(world), jax.tree.leaves(new), strict=True):
        every[rows] = some[chosen]
    return world


class _LookUp:
    """Ticks the trees of a population in states on the host; of a large vocabulary, it computes the leaves in use."""

    def __init__(self, semantics: LeafSemantics, trees: Trees) -> None:
        self._semantics = semantics
        self._jumps = _jump_table(trees)
        count = len(semantics.vocabulary)
        few = count <= FEW_TOKENS
        self._selection = semantics.everything if few else semantics.select(np.unique(trees.tokens))
        tokens = self._selection.tokens
        self._column = np.zeros(count, np.int32)
        self._column[tokens] = np.arange(len(tokens), dtype=np.int32)
        self._columns = -(-len(tokens) // COLUMNS) * COLUMNS

    def tick(
        self, tree: Int32[np.ndarray, " n"], world: World, exhausted: Int32[np.ndarray, " n"], *, trace: bool
    ) -> Ticked:
        """Tick trees in states; commands that are `exhausted` fail. Arrays of the result are NumPy's."""
        found = self._semantics.outcomes(world, self._selection)
        count, size = tree.size, next(bucket for bucket in BUCKETS if tree.size <= bucket)
        outcomes = np.zeros((2, size, self._columns), np.int32)
        outcomes[:, :count, : found.shape[2]] = found
        padded = [np.pad(values, (0, size - count)) for values in (tree, exhausted)]
        ticked = jax.device_get(_tick(self._jumps, outcomes, self._column, *padded, trace))
        return jax.tree.map(operator.itemgetter(slice(count)), ticked)


_jump_table = kept_jit(jump_table)


@kept_jit(static_argnames=("trace",))
def _tick(
    jumps: JumpTable,
    outcomes: Int32[Array, "2 n m"],
    column: Int32[Array, " V"],
    tree: Int32[Array, " n"],
    exhausted: Int32[Array, " n"],
    trace: bool,
) -> Ticked:
    """Tick trees whose leaves return `outcomes`, with those of a token in its `column`."""
    rows = jnp.arange(tree.shape[0])

    def look_up(token: Int32[Array, " n"]) -> Int32[Array, " n"]:
        first, second = outcomes[:, rows, column[token]]
        return resolve(first, second, exhausted)

    return tick_trees(jumps, look_up, tree=tree, trace=trace)
