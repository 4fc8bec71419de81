"""Episodes without a table: tick, skills and settling of a whole batch in one compiled loop.

Every episode is simulated in full, so this is the way for skills with noise and for big batches on a GPU; with
deterministic skills it gives what the table gives, more slowly.
"""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, Status, jump_table, tick_trees
from bt_jax.mjx_env.episodes.evaluator import (
    Evaluation,
    all_layouts,
    evaluation,
    in_batches,
)
from bt_jax.mjx_env.episodes.fitness import target_misses
from bt_jax.mjx_env.episodes.rules import Ending, Tally, count_tick, fresh_tally, resolve, used_up
from bt_jax.mjx_env.outcomes import command_of, subgoals_of
from bt_jax.mjx_env.physics.protocol import SettleFn
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act, reach, settled_world
from bt_jax.mjx_env.world import World, take

__all__ = ["RolloutEvaluator"]


class RolloutEvaluator:
    """Evaluate populations by simulating every transition of every episode.

    `settle` is a level as a pure JAX function: `Kinematic(task).settle` or `mjx.settle_fn(task)`. With `trace`, evaluations
    say what each leaf has returned.
    """

    def __init__(self, semantics: LeafSemantics, settle: SettleFn, *, batch: int, trace: bool = False) -> None:
        self.semantics, self.batch = semantics, batch
        self.num_broken = 0  # episodes whose simulation diverged
        self._rollout = functools.partial(_rollout, semantics, settle, trace)

    def __call__(self, trees: Trees, layouts: World, which: Int32[np.ndarray, "P K"] | None = None) -> Evaluation:
        """Run P trees [P, N] in K layouts each: rows `which` of the layouts (NumPy), or all of them."""
        starts = all_layouts(trees, layouts) if which is None else which
        result = in_batches(functools.partial(self._run, layouts), self.batch, trees, starts)
        self.num_broken += int(np.sum(result.ending == Ending.BROKEN))
        return result

    def _run(self, layouts: World, trees: Trees, starts: Int32[np.ndarray, "P K"]) -> Evaluation:
        tree = jnp.repeat(jnp.arange(starts.shape[0]), starts.shape[1])
        start = jax.tree.map(jnp.asarray, take(layouts, starts.reshape(-1)))
        world, tally = jax.device_get(self._rollout(trees, tree, start))
        return evaluation(
            self.semantics.task,
            trees,
            tally,
            misses=target_misses(self.semantics.task, world),
            reached=world.reached,
            shape=starts.shape,
        )


@kept_jit(static_argnames=("semantics", "settle", "trace"))
def _rollout(
    semantics: LeafSemantics, settle: SettleFn, trace: bool, trees: Trees, tree: Int32[Array, " E"], world: World
) -> tuple[World, Tally]:
    task = semantics.task
    jumps: JumpTable = jump_table(trees)
    rows = jnp.arange(tree.shape[0])

    def one_tick(carry):
        world, tally = carry
        outcomes, exhausted = semantics.outcomes(world), used_up(tally, task.episode)

        def look_up(token):
            return resolve(outcomes[0][rows, token], outcomes[1][rows, token], exhausted)

        ticked = tick_trees(jumps, look_up, tree=tree, trace=trace)
        command, going = command_of(ticked.noted), tally.ending == Ending.OPEN
        running = going & (ticked.status == Status.RUNNING)
        world = reach(world, jnp.where(going, subgoals_of(ticked.noted), 0))
        # Episodes that do nothing in this tick close an already closed gripper, or open an empty one: no motion.
        idle = jnp.where(world.gripper_open, 0, 1)
        released = act(semantics, world, jnp.where(running, command, idle))
        moved = (released.box >= 0)[:, None] & released.present
        settled = settle(released.world.kits, released.poses, moved)
        after = settled_world(task, released, settled.poses)
        broken = running & ~settled.ok
        acts = running & settled.ok
        world = jax.tree.map(
            lambda new, old: jnp.where(acts.reshape((-1,) + (1,) * (new.ndim - 1)), new, old), after, world
        )
        return world, count_tick(tally, ticked.status, command, broken, task.episode, ticked.trace)

    start = (world, fresh_tally(tree.shape[0], trace_nodes=trees.num_nodes if trace else None))
    return lax.while_loop(lambda carry: jnp.any(carry[1].ending == Ending.OPEN), one_tick, start)
