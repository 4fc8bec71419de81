"""Episodes of whole populations over the transition table.

All episodes advance together on the device until each has ended or needs a transition that is not in the table yet; the
host simulates the missing ones, each once, in one batch, and the episodes go on.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Bool, Float32, Int8, Int32, UInt8

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, Status, jump_table, tick_trees
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS, fitness
from bt_jax.mjx_env.episodes.rules import Ending, Tally, count_tick, fresh_tally, is_solved, resolve, select, used_up
from bt_jax.mjx_env.episodes.table import BROKEN, UNKNOWN, TransitionTable
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import LeafSemantics, command_of, subgoals_of
from bt_jax.mjx_env.world import Array, World
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
    distance: Float32[np.ndarray, "P K targets"]  # metres, at the end
    subgoals_missed: Int32[np.ndarray, "P K"]  # subgoals never reached
    solved: Bool[np.ndarray, "P K"]  # ended in SUCCESS with every target within the tolerance
    reached: Bool[np.ndarray, "P K subgoals"]
    trace: UInt8[np.ndarray, "P K N"] | None = (
        None  # what each leaf returned, where asked for (see `encoding.tick.Ticked`)
    )

    @property
    def fitness(self) -> Float32[np.ndarray, " P"]:
        """Mean over the layouts; the worst where the simulation diverged in one of them."""
        broken = (self.ending == Ending.BROKEN).any(axis=1)
        return np.where(broken, np.float32(WORST_FITNESS), self.values.mean(axis=1))


@kept_jit(static_argnames=("rules", "num_ticked"))
def _advance(
    table: JumpTable,
    tree: Int32[Array, " E"],
    state: Int32[Array, " E"],
    tally: Tally,
    outcomes: Int32[Array, "2 S V"],
    following: Int32[Array, " SC"],
    rules: Episode,
    num_ticked: int,
) -> tuple[Int32[Array, " E"], Tally, Int32[Array, " E"]]:
    """Tick until every episode has ended or waits. Return states, tally, and for each episode the index into
    `following` that it waits for, or -1. The last `num_ticked` commands are subgoals that the tree ticks."""
    _, capacity, tokens = outcomes.shape
    commands = following.shape[0] // capacity
    flat = outcomes.reshape(-1)

    def one_tick(carry):
        state, tally, _ = carry

        exhausted = used_up(tally, rules)
        some_exhausted = jnp.any(tally.runs >= rules.action_ticks)

        def look_up(token):
            at = state * tokens + token
            first = flat[at]
            second = lax.cond(some_exhausted, lambda: flat[at + capacity * tokens], lambda: first)
            return resolve(first, second, exhausted)

        ticked = tick_trees(table, look_up, tree=tree, trace=tally.trace is not None)
        command, subgoals = command_of(ticked.noted), subgoals_of(ticked.noted)
        going, waiting, now = tally.ending == Ending.OPEN, jnp.full(state.shape, -1, jnp.int32), state
        for i in range(num_ticked):
            at = now * commands + commands - num_ticked + i
            reaches, after = going & (subgoals >> i & 1 == 1), following[at]
            waiting = jnp.where(reaches & (after == UNKNOWN) & (waiting < 0), at, waiting)
            now = jnp.where(reaches & (after >= 0), after, now)
        at = now * commands + command
        running, after = going & (ticked.status == Status.RUNNING), following[at]
        waiting = jnp.where(running & (after == UNKNOWN) & (waiting < 0), at, waiting)
        now = jnp.where(running & (after >= 0), after, now)
        counted = count_tick(tally, ticked.status, command, after == BROKEN, rules, ticked.trace)
        return jnp.where(waiting < 0, now, state), select(waiting < 0, counted, tally), waiting

    def some_go_on(carry):
        _, tally, waiting = carry
        return jnp.any((tally.ending == Ending.OPEN) & (waiting < 0))

    waiting = jnp.full(state.shape, -1, jnp.int32)
    return lax.while_loop(some_go_on, one_tick, (state, tally, waiting))


_jump_table = kept_jit(jump_table, small=lambda trees: trees.tokens.shape[0] <= FEW_TREES)


class TableEvaluator:
    """Evaluate populations with a transition table that grows as it is used.

    Trees are evaluated in batches of `batch`, the last one padded, so that one shape is compiled. With `trace`, evaluations
    say what each leaf has returned.
    """

    def __init__(self, semantics: LeafSemantics, physics: Physics, *, batch: int, trace: bool = False) -> None:
        self.table, self.batch, self.trace = TransitionTable(semantics, physics), batch, trace

    @property
    def num_broken(self) -> int:
        """Transitions whose simulation diverged."""
        return self.table.num_broken

    def __call__(self, trees: Trees, layouts: World, which: Int32[np.ndarray, "P K"] | None = None) -> Evaluation:
        """Run P trees [P, N] in K layouts each: rows `which` of the layouts (NumPy), or all of them."""
        starts = self.table.ids(layouts)[all_layouts(trees, layouts) if which is None else which]
        return in_batches(self._run, self.batch, trees, starts)

    def _run(self, trees: Trees, starts: Int32[np.ndarray, "P K"]) -> Evaluation:
        tree = np.repeat(np.arange(starts.shape[0], dtype=np.int32), starts.shape[1])
        fresh = fresh_tally(starts.size, trace_nodes=trees.num_nodes if self.trace else None)
        state, tally = self._finish(_jump_table(trees), tree, starts.reshape(-1), fresh)
        state = np.asarray(state)
        return evaluation(
            self.table.semantics.task,
            trees,
            tally,
            distance=self.table.distance(state),
            reached=self.table.reached(state),
            shape=starts.shape,
        )

    def _finish(
        self, jumps: JumpTable, tree: Int32[np.ndarray, " E"], state: Int32[Array, " E"], tally: Tally
    ) -> tuple[Int32[Array, " E"], Tally]:
        """Return states and tally of all episodes at their ends. Where many have ended, the others go on by themselves."""
        few = tree.size // FEW if tree.size >= MANY else 0
        table = self.table
        while True:
            state, tally, waiting = _advance(
                jumps,
                tree,
                state,
                tally,
                table.outcomes,
                table.following,
                table.semantics.task.episode,
                table.semantics.num_ticked,
            )
            waiting = np.asarray(waiting)
            missing = np.unique(waiting[waiting >= 0])
            if not missing.size:
                return state, tally
            table.learn(*np.divmod(missing, table.num_commands))
            rows = np.flatnonzero(waiting >= 0)
            if rows.size <= few:
                rows = np.resize(rows, few)  # some of them several times
                whole = jax.tree.map(np.array, (state, tally))
                part = self._finish(jumps, tree[rows], *jax.tree.map(operator.itemgetter(rows), whole))
                for leaf, ended in zip(jax.tree.leaves(whole), jax.tree.leaves(part), strict=True):
                    leaf[rows] = ended
                return whole


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
    distance: Float32[np.ndarray, "E targets"],
    reached: Bool[np.ndarray, "E subgoals"],
    shape: tuple[int, int],
) -> Evaluation:
    """Return the evaluation of E = P * K episodes from their final distances [m] and the subgoals that they reached; `shape`
    is (P, K)."""
    ending, ticks = np.asarray(tally.ending).reshape(shape), np.asarray(tally.ticks).reshape(shape)
    distance, reached = distance.reshape(*shape, -1), reached.reshape(*shape, reached.shape[-1])
    subgoals_missed = np.sum(~reached, axis=-1, dtype=np.int32)
    trace = None if tally.trace is None else np.asarray(tally.trace).reshape(*shape, -1)
    nodes = np.asarray(trees.sizes)[:, :1].astype(np.int32)
    values = fitness(
        task,
        distance=distance.sum(axis=-1),
        subgoals_missed=subgoals_missed,
        nodes=np.broadcast_to(nodes, shape),
        ending=ending,
    )
    solved = is_solved(ending, distance, task.episode)
    return Evaluation(values, ending, ticks, distance, subgoals_missed, solved, reached, trace)
