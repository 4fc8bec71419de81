"""Rollouts whose physics are on the host, the C engine with its threads among them."""

from __future__ import annotations

import operator

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Int, Int32, UInt8

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, Ticked, counters, jump_table, tick_trees
from bt_jax.mjx_env.driving import driven
from bt_jax.mjx_env.episodes.columns import Chances
from bt_jax.mjx_env.episodes.rules import NO_COMMAND, Ending, Tally, count_tick, fresh_tally, resolve, used_up
from bt_jax.mjx_env.faults.fates import between_ticks, carry_out, something_happens
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.outcomes import ACTION, command_of, subgoals_of
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
        self._variants = Variants(semantics)
        self._settler = Settler(semantics.task, physics)
        self._forgetful = Settler(semantics.task, physics, memory=0)

    def __call__(
        self, trees: Trees, tree: Int32[np.ndarray, " E"], start: World, chances: Chances | None
    ) -> tuple[World, Tally]:
        """Return states and tally (NumPy) at the ends of E episodes: trees `tree` from states `start`, with what chance has
        in store for each of them."""
        look_up = _LookUp(self.semantics, trees)
        fresh = fresh_tally(
            tree.size,
            num_nodes=trees.num_nodes,
            trace=self.trace,
            counting=bool(self.semantics.vocabulary.decorators),
            has_faults=chances is not None,
            drives=start.base is not None,
        )
        ends = jax.tree.map(np.array, (start, fresh))
        for first in range(0, tree.size, ROWS):
            rows = np.arange(first, min(first + ROWS, tree.size))
            while rows.size:
                world, tally = jax.tree.map(operator.itemgetter(rows), ends)
                after = self._tick(look_up, tree[rows], world, tally, None if chances is None else chances.of(rows))
                for every, new in zip(jax.tree.leaves(ends), jax.tree.leaves(after), strict=True):
                    every[rows] = new
                rows = rows[after[1].ending == Ending.OPEN]
        return ends

    def _tick(
        self, look_up: _LookUp, tree: Int32[np.ndarray, " n"], world: World, tally: Tally, chances: Chances | None
    ) -> tuple[World, Tally]:
        """Return states and tally one tick later."""
        task, tick = self.semantics.task, tally.ticks
        ticked = look_up.tick(tree, world, used_up(tally, task.episode), tally.counts, trace=self.trace)
        command = np.where(ticked.acts, command_of(ticked.noted), np.int32(NO_COMMAND))
        broken, struck = np.zeros(tree.size, bool), None
        stood, world = world.base, reach(world, subgoals_of(ticked.noted))
        running = np.flatnonzero(ticked.acts)
        if running.size:
            fates = None if chances is None else chances.fates[running]
            released = carry_out(self._variants, take(world, running), command[running], fates, tick[running])
            poses, ok = self._settler_of(chances).settle(released)
            broken[running] = ~ok
            world = _replaced(world, running[ok], settled_world(task, released, poses), ok)
        if chances is not None:
            struck = chances.struck(chances.column(command, tick), command)
        travel = driven(stood, world.base)
        counted = count_tick(
            tally, ticked.status, command, broken, task.episode, ticked.trace, ticked.counts, struck, travel
        )
        if chances is not None:
            rows = np.flatnonzero((counted.ending == Ending.OPEN) & something_happens(chances.fates, tick))
            own, before = chances.of(rows), take(world, rows)
            after = between_ticks(before, task, own.fates, tick[rows])
            world = _replaced(world, rows, after)
            assert counted.struck is not None
            counted.struck[rows] |= own.struck_between(self.semantics.task, before, after, tick[rows])
        return world, counted

    def _settler_of(self, chances: Chances | None) -> Settler:
        """Return what remembers its solutions, unless errors are continuous: then no problem comes twice."""
        return self._forgetful if chances is not None and chances.fates.unit is not None else self._settler


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
        self._jumps = _jump_table(trees, counters(semantics.vocabulary))
        count = len(semantics.vocabulary)
        few = count <= FEW_TOKENS
        self._selection = semantics.everything if few else semantics.select(np.unique(trees.tokens))
        tokens = self._selection.tokens
        self._column = np.zeros(count, np.int32)
        self._column[tokens] = np.arange(len(tokens), dtype=np.int32)
        self._columns = -(-len(tokens) // COLUMNS) * COLUMNS

    def tick(
        self,
        tree: Int32[np.ndarray, " n"],
        world: World,
        exhausted: Int32[np.ndarray, " n"],
        counts: UInt8[np.ndarray, "n N"] | None,
        *,
        trace: bool,
    ) -> Ticked:
        """Tick trees in states; commands that are `exhausted` fail, and decorators have counted `counts`. Arrays of the
        result are NumPy's."""
        found = self._semantics.outcomes(world, self._selection)
        count, size = tree.size, next(bucket for bucket in BUCKETS if tree.size <= bucket)
        outcomes = np.zeros((2, size, self._columns), np.int32)
        outcomes[:, :count, : found.shape[2]] = found
        padded = [np.pad(values, (0, size - count)) for values in (tree, exhausted)]
        counted = None if counts is None else np.pad(counts, ((0, size - count), (0, 0)))
        ticked = jax.device_get(_tick(self._jumps, outcomes, self._column, *padded, counted, trace))
        return jax.tree.map(operator.itemgetter(slice(count)), ticked)


_jump_table = kept_jit(jump_table)


@kept_jit(static_argnames=("trace",))
def _tick(
    jumps: JumpTable,
    outcomes: Int32[Array, "2 n m"],
    column: Int32[Array, " V"],
    tree: Int32[Array, " n"],
    exhausted: Int32[Array, " n"],
    counts: UInt8[Array, "n N"] | None,
    trace: bool,
) -> Ticked:
    """Tick trees whose leaves return `outcomes`, with those of a token in its `column`."""
    rows = jnp.arange(tree.shape[0])

    def look_up(token: Int32[Array, " n"]) -> Int32[Array, " n"]:
        first, second = outcomes[:, rows, column[token]]
        return resolve(first, second, exhausted)

    return tick_trees(jumps, look_up, tree=tree, trace=trace, counts=counts, halted=int(ACTION))
