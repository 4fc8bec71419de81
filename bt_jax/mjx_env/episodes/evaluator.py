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
from jaxtyping import Bool, Float32, Int8, Int16, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, Status, jump_table, tick_trees
from bt_jax.mjx_env.episodes.fitness import WORST_FITNESS, Ending, fitness
from bt_jax.mjx_env.episodes.table import BROKEN, UNKNOWN, TransitionTable
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.semantics import COMMAND_BITS, LeafSemantics
from bt_jax.mjx_env.world import Array, World
from bt_jax.tasks import Episode, Task

__all__ = [
    "Evaluation",
    "Progress",
    "TableEvaluator",
    "all_layouts",
    "evaluation",
    "fresh_progress",
    "in_batches",
    "resolve",
    "update_progress",
]

MANY = 512  # from so many episodes on,
FEW = 8  # those that wait go on by themselves once they are at most one in so many


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

    @property
    def fitness(self) -> Float32[np.ndarray, "P"]:
        """Mean over the layouts; the worst where physics gave no number in one of them."""
        broken = (self.ending == Ending.BROKEN).any(axis=1)
        return np.where(broken, np.float32(WORST_FITNESS), self.values.mean(axis=1))


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Progress:
    """How far episodes have come."""

    ticks: Int32[Anywhere, "E"]
    successes: Int32[Anywhere, "E"]  # consecutive ticks that returned SUCCESS
    command: Int32[Anywhere, "E"]  # that ran last, or -1
    runs: Int32[Anywhere, "E"]  # consecutive ticks that it ran
    ending: Int8[Anywhere, "E"]


def fresh_progress(count: int) -> Progress:
    """Progress of episodes that have not begun."""
    zeros = np.zeros(count, np.int32)
    return Progress(zeros, zeros, zeros - 1, zeros, np.zeros(count, np.int8))


def resolve(
    outcome: Int16[Array, "E"], second: Int16[Array, "E"], progress: Progress, limit: int
) -> tuple[Int8[Array, "E"], Int32[Array, "E"]]:
    """Status and command of a leaf from its two outcomes (see `LeafSemantics.outcomes`): the second counts where the command
    that the first one runs has used up its `limit` of ticks."""
    command = (outcome >> COMMAND_BITS).astype(jnp.int32)
    running = outcome & 3 == Status.RUNNING
    exhausted = running & (command == progress.command) & (progress.runs >= limit)
    outcome = jnp.where(exhausted, second, outcome)
    return (outcome & 3).astype(jnp.int8), (outcome >> COMMAND_BITS).astype(jnp.int32)


def update_progress(
    progress: Progress,
    status: Int8[Array, "E"],
    command: Int32[Array, "E"],
    broken: Bool[Array, "E"],
    wait: Bool[Array, "E"],
    rules: Episode,
) -> Progress:
    """Counts one tick with the given root status and running command; episodes that ended or `wait` stay as they are."""
    active = (progress.ending == Ending.OPEN) & ~wait
    running = status == Status.RUNNING
    ticks = progress.ticks + 1
    successes = jnp.where(status == Status.SUCCESS, progress.successes + 1, 0)
    same = running & (command == progress.command)
    runs = jnp.where(running, jnp.where(same, progress.runs + 1, 1), 0)
    ending = jnp.where(ticks >= rules.max_ticks, Ending.TIMEOUT, Ending.OPEN)
    ending = jnp.where(successes >= rules.success_ticks, Ending.SUCCESS, ending)
    ending = jnp.where(status == Status.FAILURE, Ending.FAILURE, ending)
    ending = jnp.where(running & broken, Ending.BROKEN, ending).astype(jnp.int8)
    new = Progress(ticks, successes, jnp.where(running, command, -1), runs, ending)
    return jax.tree.map(lambda after, before: jnp.where(active, after, before), new, progress)


@kept_jit(static_argnames=("rules",))
def _advance(
    table: JumpTable,
    tree: Int32[Array, "E"],
    state: Int32[Array, "E"],
    progress: Progress,
    outcomes: Int16[Array, "2 S V"],
    following: Int32[Array, "SC"],
    rules: Episode,
) -> tuple[Int32[Array, "E"], Progress, Int32[Array, "E"]]:
    """Ticks until every episode has ended or waits. Returns states, progress, and for each episode the index into
    `following` that it waits for, or -1."""
    _, capacity, tokens = outcomes.shape
    commands = following.shape[0] // capacity
    flat = outcomes.reshape(-1)

    def one_tick(carry):
        state, progress, _ = carry

        some_exhausted = jnp.any(progress.runs >= rules.action_ticks)

        def look_up(token):
            at = state * tokens + token
            first = flat[at]
            second = lax.cond(some_exhausted, lambda: flat[at + capacity * tokens], lambda: first)
            return resolve(first, second, progress, rules.action_ticks)

        ticked = tick_trees(table, lambda token: look_up(token)[0], tree=tree)
        num_nodes = table.words.shape[1]
        leaf = table.words.reshape(-1)[tree * num_nodes + jnp.minimum(ticked.leaf, num_nodes - 1)] >> 16
        _, command = look_up(leaf)
        at = state * commands + command
        after = following[at]
        running = (ticked.status == Status.RUNNING) & (progress.ending == Ending.OPEN)
        wait = running & (after == UNKNOWN)
        progress = update_progress(progress, ticked.status, command, after == BROKEN, wait, rules)
        state = jnp.where(running & (after >= 0), after, state)
        return state, progress, jnp.where(wait, at, -1)

    def some_go_on(carry):
        _, progress, waiting = carry
        return jnp.any((progress.ending == Ending.OPEN) & (waiting < 0))

    waiting = jnp.full(state.shape, -1, jnp.int32)
    return lax.while_loop(some_go_on, one_tick, (state, progress, waiting))


_jump_table = kept_jit(jump_table)


class TableEvaluator:
    """Evaluates populations with a transition table that grows as it is used.

    Trees are evaluated in batches of `batch`, the last one padded, so that one shape is compiled.
    """

    def __init__(self, semantics: LeafSemantics, physics: Physics, *, batch: int) -> None:
        self.table, self.batch = TransitionTable(semantics, physics), batch

    @property
    def num_broken(self) -> int:
        """Transitions to which physics gave no number."""
        return self.table.num_broken

    def __call__(self, trees: Trees, layouts: World, which: Int32[np.ndarray, "P K"] | None = None) -> Evaluation:
        """Runs P trees [P, N] in K layouts each: rows `which` of the layouts (NumPy), or all of them."""
        starts = self.table.ids(layouts)[all_layouts(trees, layouts) if which is None else which]
        return in_batches(self._run, self.batch, trees, starts)

    def _run(self, trees: Trees, starts: Int32[np.ndarray, "P K"]) -> Evaluation:
        tree = np.repeat(np.arange(starts.shape[0], dtype=np.int32), starts.shape[1])
        state, progress = self._finish(_jump_table(trees), tree, starts.reshape(-1), fresh_progress(starts.size))
        state = np.asarray(state)
        return evaluation(
            self.table.semantics.task,
            trees,
            progress,
            distance=self.table.distance(state),
            subgoals_missed=self.table.subgoals_missed(state),
            shape=starts.shape,
        )

    def _finish(
        self, jumps: JumpTable, tree: Int32[np.ndarray, "E"], state: Int32[Array, "E"], progress: Progress
    ) -> tuple[Int32[Array, "E"], Progress]:
        """States and progress of all episodes at their ends. Where many have ended, the others go on by themselves."""
        few = tree.size // FEW if tree.size >= MANY else 0
        table = self.table
        while True:
            state, progress, waiting = _advance(
                jumps, tree, state, progress, table.outcomes, table.following, table.semantics.task.episode
            )
            waiting = np.asarray(waiting)
            missing = np.unique(waiting[waiting >= 0])
            if not missing.size:
                return state, progress
            table.learn(*np.divmod(missing, table.num_commands))
            rows = np.flatnonzero(waiting >= 0)
            if rows.size <= few:
                rows = np.resize(rows, few)  # some of them several times
                whole = jax.tree.map(np.array, (state, progress))
                part = self._finish(jumps, tree[rows], *jax.tree.map(operator.itemgetter(rows), whole))
                for leaf, ended in zip(jax.tree.leaves(whole), jax.tree.leaves(part), strict=True):
                    leaf[rows] = ended
                return whole


def all_layouts(trees: Trees, layouts: World) -> Int32[np.ndarray, "P K"]:
    """Every tree in every layout."""
    count = layouts.held.shape[0]
    return np.tile(np.arange(count, dtype=np.int32), (trees.tokens.shape[0], 1))


def in_batches(
    run: Callable[[Trees, Int32[np.ndarray, "P K"]], Evaluation],
    batch: int,
    trees: Trees,
    starts: Int32[np.ndarray, "P K"],
) -> Evaluation:
    """Calls `run` with `batch` trees at a time, repeating the last one to fill up, and joins what it returns."""
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
    progress: Progress,
    *,
    distance: Float32[np.ndarray, "E targets"],
    subgoals_missed: Int32[np.ndarray, "E"],
    shape: tuple[int, int],
) -> Evaluation:
    """Evaluation of E = P * K episodes from their final distances [m] and missed subgoals; `shape` is (P, K)."""
    ending, ticks = np.asarray(progress.ending).reshape(shape), np.asarray(progress.ticks).reshape(shape)
    distance, subgoals_missed = distance.reshape(*shape, -1), subgoals_missed.reshape(shape)
    nodes = np.asarray(trees.sizes)[:, :1].astype(np.int32)
    values = fitness(
        task,
        distance=distance.sum(axis=-1),
        subgoals_missed=subgoals_missed,
        nodes=np.broadcast_to(nodes, shape),
        ending=ending,
    )
    solved = (ending == Ending.SUCCESS) & (distance < task.episode.tolerance).all(axis=-1)
    return Evaluation(values, ending, ticks, distance, subgoals_missed, solved)
