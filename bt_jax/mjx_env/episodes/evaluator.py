"""Episodes of whole populations over the transition table.

All episodes advance together on the device until each has ended or needs a transition that is not in the table yet; the
host simulates the missing ones, each once, in one batch, and the episodes go on.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import operator
from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float32, Int8, Int32, UInt8

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, counters, jump_table, tick_trees
from bt_jax.mjx_env.driving import driven
from bt_jax.mjx_env.episodes.columns import Chances, Extent, tick_of
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS, Misses, fitness
from bt_jax.mjx_env.episodes.rules import (
    NO_COMMAND,
    Ending,
    Tally,
    count_tick,
    fresh_tally,
    is_solved,
    resolve,
    select,
    used_up,
)
from bt_jax.mjx_env.episodes.table import BROKEN, MEMORY, UNKNOWN, Known, TableFullError, TransitionTable
from bt_jax.mjx_env.faults.fates import Fates
from bt_jax.mjx_env.outcomes import ACTION, command_of, subgoals_of
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.world import Array, World, take
from bt_jax.tasks import Episode, Task

__all__ = [
    "Evaluation",
    "TableEvaluator",
    "all_layouts",
    "evaluation",
    "in_batches",
]

FEW_TREES = 32  # up to this number of trees, building their tables takes no time to speak of
MANY = 512  # from this number of episodes on,
FEW = 8  # those that wait go on by themselves once they are at most one in eight


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Evaluation:
    """The episodes of P trees in K layouts (NumPy)."""

    values: Float32[np.ndarray, "P K"]  # fitness of each episode
    ending: Int8[np.ndarray, "P K"]
    ticks: Int32[np.ndarray, "P K"]
    misses: Misses  # [P, K, targets], at the end
    subgoals_missed: Int32[np.ndarray, "P K"]  # subgoals never reached
    solved: Bool[np.ndarray, "P K"]  # ended in SUCCESS with every target within the tolerance
    reached: Bool[np.ndarray, "P K subgoals"]
    trace: UInt8[np.ndarray, "P K N"] | None = (
        None  # what each leaf returned, where asked for (see `encoding.tick.Ticked`)
    )
    struck: Int32[np.ndarray, "P K"] | None = None  # faults that happened, as bits, in a task that has any
    travel: Float32[np.ndarray, "P K"] | None = None  # metres driven, where the robot drives

    @property
    def fitness(self) -> Float32[np.ndarray, " P"]:
        """Mean over the layouts; the worst where the simulation diverged in one of them."""
        return self._unless_broken(self.values.mean(axis=1))

    def lower_mean(self, share: float) -> Float32[np.ndarray, " P"]:
        """Return the fitness as the mean of a share of the episodes, the worst ones: the conditional value at risk
        (Rockafellar and Uryasev 2000)."""
        if share >= 1:
            return self.fitness
        count = math.ceil(share * self.values.shape[1])
        return self._unless_broken(np.sort(self.values, axis=1)[:, :count].mean(axis=1))

    def _unless_broken(self, fitness: Float32[np.ndarray, " P"]) -> Float32[np.ndarray, " P"]:
        broken = (self.ending == Ending.BROKEN).any(axis=1)
        return np.where(broken, np.float32(WORST_FITNESS), fitness)


class _Asked(NamedTuple):
    """What E episodes wait for: where a column leads from a state, or, with the column behind the last, what leaves return
    in it. The column is -1 where an episode does not wait."""

    state: Int32[Array, " E"]
    column: Int32[Array, " E"]


@kept_jit(static_argnames=("rules", "columns"))
def _advance(
    table: JumpTable,
    tree: Int32[Array, " E"],
    state: Int32[Array, " E"],
    tally: Tally,
    known: Known,
    chances: Chances | None,
    rules: Episode,
    columns: Extent,
) -> tuple[Int32[Array, " E"], Tally, _Asked]:
    """Tick until every episode has ended or waits. Return states, tally, and what the episodes wait for."""

    def one_tick(carry):
        state, tally, _ = carry
        exhausted = used_up(tally, rules)

        def look_up(token):
            return resolve(*known.outcomes(state, token), exhausted)

        def follow(now, asked, goes, column):
            goes, after = goes & (asked.column < 0), known.following.at(now, column)
            missing = goes & (after == UNKNOWN)
            asked = _Asked(jnp.where(missing, now, asked.state), jnp.where(missing, column, asked.column))
            return jnp.where(goes & (after >= 0), after, now), asked, after

        traced, counts = tally.trace is not None, tally.counts
        ticked = tick_trees(table, look_up, tree=tree, trace=traced, counts=counts, halted=int(ACTION))
        command, subgoals = command_of(ticked.noted), subgoals_of(ticked.noted)
        going, now = tally.ending == Ending.OPEN, state
        unread = going & (ticked.noted < 0)  # NOT_COMPUTED is among what was noted
        asked = _Asked(jnp.where(unread, state, -1), jnp.where(unread, columns.num, -1))
        for i in range(columns.num_ticked):
            subgoal = jnp.full_like(command, columns.subgoals + i)
            now, asked, _ = follow(now, asked, going & (subgoals >> i & 1 == 1), subgoal)
        column, struck = command, None
        if chances is not None:
            column = chances.column(command, tick_of(tally, chances.fates))
            struck = chances.struck(column, command)
        now, asked, after = follow(now, asked, going & ticked.acts, column)
        ran, broken = jnp.where(ticked.acts, command, NO_COMMAND), after == BROKEN
        travel = None if known.base is None else driven(known.base[state], known.base[now])
        counted = count_tick(tally, ticked.status, ran, broken, rules, ticked.trace, ticked.counts, struck, travel)
        if chances is not None:
            goes = going & (counted.ending == Ending.OPEN)
            for happens, column, fault in chances.between(columns, tick_of(tally, chances.fates)):
                before = now
                now, asked, _ = follow(now, asked, goes & happens, column)
                found = jnp.where(now != before, fault, 0)
                assert counted.struck is not None
                counted = dataclasses.replace(counted, struck=counted.struck | found)
        goes_on = asked.column < 0
        return jnp.where(goes_on, now, state), select(goes_on, counted, tally), asked

    def some_go_on(carry):
        _, tally, asked = carry
        return jnp.any((tally.ending == Ending.OPEN) & (asked.column < 0))

    nothing = _Asked(jnp.full_like(state, -1), jnp.full_like(state, -1))
    return lax.while_loop(some_go_on, one_tick, (state, tally, nothing))


_jump_table = kept_jit(jump_table, small=lambda trees, *_: trees.tokens.shape[0] <= FEW_TREES)


class _Ends(NamedTuple):
    """How E episodes ended."""

    tally: Tally
    misses: Misses
    reached: Bool[np.ndarray, "E subgoals"]


class TableEvaluator:
    """Evaluate populations with a transition table that grows as it is used, in at most `memory` bytes.

    Trees are evaluated in batches of `batch`, the last one padded, so that one shape is compiled. With `trace`, evaluations
    say what each leaf has returned.
    """

    def __init__(
        self, semantics: LeafSemantics, physics: Physics, *, batch: int, trace: bool = False, memory: int = MEMORY
    ) -> None:
        self.table, self.batch, self.trace = TransitionTable(semantics, physics, memory=memory), batch, trace
        self.num_followed = 0  # commands that episodes ran, of which the table knew some already

    @property
    def hit_rate(self) -> float:
        """The share of the commands that episodes ran whose transition the table knew already; 1 before the first."""
        return 1 - self.table.num_transitions / self.num_followed if self.num_followed else 1.0

    @property
    def num_broken(self) -> int:
        """Transitions whose simulation diverged."""
        return self.table.num_broken

    def __call__(
        self,
        trees: Trees,
        layouts: World,
        which: Int32[np.ndarray, "P K"] | None = None,
        fates: Fates | None = None,
    ) -> Evaluation:
        """Run P trees [P, N] in K layouts each: rows `which` of the layouts (NumPy), or all of them. `fates`: one for each
        of the layouts, of which the same one may stand there several times; nothing goes wrong without them."""
        starts = all_layouts(trees, layouts) if which is None else which
        return in_batches(functools.partial(self._run, layouts, fates), self.batch, trees, starts)

    def _run(self, layouts: World, fates: Fates | None, trees: Trees, starts: Int32[np.ndarray, "P K"]) -> Evaluation:
        tree = np.repeat(np.arange(starts.shape[0], dtype=np.int32), starts.shape[1])
        self.table.use(np.asarray(trees.tokens))
        task = self.table.semantics.task
        jumps = _jump_table(trees, counters(self.table.semantics.vocabulary))
        fresh = fresh_tally(
            starts.size,
            num_nodes=trees.num_nodes,
            trace=self.trace,
            counting=jumps.counting is not None,
            has_faults=task.faults is not None,
            drives=task.robot.base is not None,
        )
        ends = self._ends(jumps, tree, layouts, fates, starts.reshape(-1), fresh)
        return evaluation(
            self.table.semantics.task,
            trees,
            ends.tally,
            misses=ends.misses,
            reached=ends.reached,
            shape=starts.shape,
        )

    def _ends(
        self,
        jumps: JumpTable,
        tree: Int32[np.ndarray, " E"],
        layouts: World,
        fates: Fates | None,
        start: Int32[np.ndarray, " E"],
        fresh: Tally,
    ) -> _Ends:
        """Run E episodes from layouts `start`. If the table gets full, it forgets, and they run again; if an empty table is
        not enough for all of them, first one half, then the other."""
        parts, ends = [np.arange(tree.size)], []
        while parts:
            rows = parts.pop()
            was_empty = self.table.num_states == 0
            try:
                padded = rows if rows.size == tree.size else np.resize(rows, tree.size)  # some of them several times
                found = self._walked(jumps, tree[padded], layouts, fates, start[padded], fresh)
            except TableFullError:
                if was_empty and rows.size == 1:
                    raise
                self.table.forget()
                parts += np.array_split(rows, 2)[::-1] if was_empty else [rows]
            else:
                whole = rows.size == tree.size
                ends.append(found if whole else jax.tree.map(operator.itemgetter(slice(rows.size)), found))
        return ends[0] if len(ends) == 1 else jax.tree.map(lambda *leaves: np.concatenate(leaves), *ends)

    def _walked(
        self,
        jumps: JumpTable,
        tree: Int32[np.ndarray, " E"],
        layouts: World,
        fates: Fates | None,
        start: Int32[np.ndarray, " E"],
        fresh: Tally,
    ) -> _Ends:
        """Run E episodes from layouts `start`. Raise TableFullError."""
        used, each = np.unique(start, return_inverse=True)
        first = self.table.ids(take(layouts, used))[each]
        chances = self.table.columns.chances(None if fates is None else fates[start], start.size)
        state, tally = self._finish(jumps, tree, first, fresh, chances)
        state = np.asarray(state)
        self.num_followed += _commands_run(tally, self.table.semantics.task.episode)
        return _Ends(tally, self.table.misses(state), self.table.reached(state))

    def _finish(
        self,
        jumps: JumpTable,
        tree: Int32[np.ndarray, " E"],
        state: Int32[Array, " E"],
        tally: Tally,
        chances: Chances | None,
    ) -> tuple[Int32[Array, " E"], Tally]:
        """Return states and tally of all episodes at their ends. Where many have ended, the others go on by themselves."""
        few = tree.size // FEW if tree.size >= MANY else 0
        table, chances_here = self.table, jax.device_put(chances)
        columns = table.columns.extent
        while True:
            rules = table.semantics.task.episode
            state, tally, asked = _advance(jumps, tree, state, tally, table.known, chances_here, rules, columns)
            at, column = map(np.asarray, asked)
            rows = np.flatnonzero(column >= 0)
            if not rows.size:
                return state, tally
            missing = np.unique(at[rows].astype(np.int64) * (columns.num + 1) + column[rows])
            states, wanted = (part.astype(np.int32) for part in np.divmod(missing, columns.num + 1))
            unread = wanted == columns.num
            table.complete(states[unread])
            table.learn(states[~unread], wanted[~unread])
            if rows.size <= few:
                rows = np.resize(rows, few)  # some of them several times
                whole = jax.tree.map(np.array, (state, tally))
                now, so_far = jax.tree.map(operator.itemgetter(rows), whole)
                own = None if chances is None else chances.of(rows)
                part = self._finish(jumps, tree[rows], now, so_far, own)
                for leaf, ended in zip(jax.tree.leaves(whole), jax.tree.leaves(part), strict=True):
                    leaf[rows] = ended
                return whole


def _commands_run(tally: Tally, rules: Episode) -> int:
    """Return how many commands E episodes ran, at least: one in each tick but those in which they ended."""
    ending, ticks = np.asarray(tally.ending), np.asarray(tally.ticks)
    idle = np.select([ending == Ending.SUCCESS, ending == Ending.FAILURE], [rules.success_ticks, 1], 0)
    return int((ticks - idle).sum())


def all_layouts(trees: Trees, layouts: World) -> Int32[np.ndarray, "P K"]:
    """Return the rows that run every tree in every layout."""
    count = layouts.held.shape[0]
    return np.tile(np.arange(count, dtype=np.int32), (trees.tokens.shape[0], 1))


def in_batches(
    run: Callable[[Trees, Int32[np.ndarray, "P K"]], Evaluation],
    batch: int,
    trees: Trees,
    starts: Int32[np.ndarray, "P K"],
) -> Evaluation:
    """Call `run` with `batch` trees at a time, repeating the last one to fill up, and join what it returns."""
    population = trees.tokens.shape[0]
    if population == batch:
        return run(trees, starts)
    trees = jax.device_get(trees)
    parts = []
    for first in range(0, population, batch):
        rows = np.minimum(np.arange(first, first + batch), population - 1)
        part = run(trees[rows], starts[rows])
        parts.append(jax.tree.map(operator.itemgetter(slice(population - first)), part))
    return parts[0] if len(parts) == 1 else jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def evaluation(
    task: Task,
    trees: Trees,
    tally: Tally,
    *,
    misses: Misses,
    reached: Bool[np.ndarray, "E subgoals"],
    shape: tuple[int, int],
) -> Evaluation:
    """Return the evaluation of E = P * K episodes from how far they missed their targets and the subgoals that they
    reached; `shape` is (P, K)."""
    ending, ticks = np.asarray(tally.ending).reshape(shape), np.asarray(tally.ticks).reshape(shape)
    reached = reached.reshape(*shape, reached.shape[-1])
    misses = Misses(*(leaf.reshape(*shape, -1) for leaf in (misses.distance, misses.turn, misses.met)))
    subgoals_missed = (~reached).sum(axis=-1, dtype=np.int32)
    trace = None if tally.trace is None else np.asarray(tally.trace).reshape(*shape, -1)
    struck = None if tally.struck is None else np.asarray(tally.struck).reshape(shape)
    travel = None if tally.travel is None else np.asarray(tally.travel).reshape(shape)
    nodes = np.asarray(trees.sizes)[:, :1].astype(np.int32)
    turned = any(target.turn is not None for target in task.targets)  # otherwise all turns are 0
    values = fitness(
        task,
        distance=misses.distance.sum(axis=-1),
        turn=misses.turn.sum(axis=-1) if turned else 0.0,
        subgoals_missed=subgoals_missed,
        nodes=np.broadcast_to(nodes, shape),
        ending=ending,
        travel=travel,
    )
    solved = is_solved(ending, misses.met)
    return Evaluation(values, ending, ticks, misses, subgoals_missed, solved, reached, trace, struck, travel)
