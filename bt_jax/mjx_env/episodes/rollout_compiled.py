"""Rollouts in one compiled loop.

Every lane holds an episode. Physics steps all lanes together until enough of them rest; these finish their tick and begin
the next one, while the others go on settling from where they are. A lane whose episode has ended takes the next episode. So
a lane waits neither for the longest settling of a tick nor for the longest episode of the batch.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Bool, Int8, Int32, UInt8

from bt_jax._util.compile_cache import kept_jit
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.tick import JumpTable, counters, jump_table, tick_trees
from bt_jax.mjx_env.driving import driven
from bt_jax.mjx_env.episodes.columns import Chances
from bt_jax.mjx_env.episodes.rules import NO_COMMAND, Ending, Tally, count_tick, fresh_tally, resolve, select, used_up
from bt_jax.mjx_env.faults.fates import between_ticks, carry_out
from bt_jax.mjx_env.faults.variants import Variants
from bt_jax.mjx_env.outcomes import ACTION, command_of, subgoals_of
from bt_jax.mjx_env.physics.neighbourhood import neighbours
from bt_jax.mjx_env.physics.protocol import Stepper
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Released, reach, settled_world
from bt_jax.mjx_env.world import Array, World

__all__ = ["rollout"]

SHARE = 8  # lanes go on to their next tick once at least one in so many of them waits for it


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Lanes:
    """W episodes, each in the middle of a tick: the tree has been ticked, and what it has moved is settling."""

    episode: Int32[Array, " W"]  # the number of episodes where none is left
    world: World  # before anything has moved
    tally: Tally  # of the ticks before
    status: Int8[Array, " W"]  # that the tree has returned
    command: Int32[Array, " W"]  # that runs, or NO_COMMAND
    trace: UInt8[Array, "W N"] | None
    counts: UInt8[Array, "W N"] | None
    released: Released
    motion: Any


@kept_jit(static_argnames=("semantics", "stepper", "trace"))
def rollout(
    semantics: LeafSemantics,
    stepper: Stepper,
    trace: bool,
    trees: Trees,
    tree: Int32[Array, " E"],
    start: World,
    chances: Chances | None,
) -> tuple[World, Tally]:
    """Return states and tally at the ends of E episodes: trees `tree` from states `start`, with what chance has in store for
    each of them."""
    jumps, episodes = jump_table(trees, counters(semantics.vocabulary)), tree.shape[0]
    width = min(stepper.lanes or episodes, episodes)
    fresh = fresh_tally(
        width,
        num_nodes=trees.num_nodes,
        trace=trace,
        counting=jumps.counting is not None,
        has_faults=chances is not None,
        drives=start.base is not None,
    )
    fresh = jax.tree.map(jnp.asarray, fresh)

    def of(episode: Int32[Array, " W"], every: Any) -> Any:
        return jax.tree.map(lambda leaf: leaf[jnp.minimum(episode, episodes - 1)], every)

    def chances_of(episode: Int32[Array, " W"]) -> Chances | None:
        return None if chances is None else dataclasses.replace(chances, fates=of(episode, chances.fates))

    def ticked(episode: Int32[Array, " W"], world: World, tally: Tally) -> _Lanes:
        return _ticked(semantics, stepper, jumps, of(episode, tree), chances_of(episode), episode, world, tally)

    def body(carry: tuple[_Lanes, Array, tuple[World, Tally]]) -> tuple[_Lanes, Array, tuple[World, Tally]]:
        lanes, taken, ends = carry
        motion = _settle_some(stepper, lanes.motion, lanes.episode < episodes)
        rests, lanes = stepper.rests(motion), dataclasses.replace(lanes, motion=motion)
        world, tally = _finished(semantics, stepper, lanes, chances_of(lanes.episode))
        ended = rests & ((tally.ending != Ending.OPEN) | (lanes.episode >= episodes))
        where = jnp.where(ended, lanes.episode, episodes)  # out of range: dropped
        ends = jax.tree.map(lambda every, new: every.at[where].set(new, mode="drop"), ends, (world, tally))
        order = jnp.cumsum(ended.astype(jnp.int32)) - 1
        episode = jnp.where(ended, jnp.minimum(taken + order, episodes), lanes.episode)
        following = ticked(episode, _where(ended, of(episode, start), world), select(ended, fresh, tally))
        taken = jnp.minimum(taken + ended.sum(dtype=jnp.int32), episodes)
        return _where(rests, following, lanes), taken, ends

    # Lanes begin as if their episodes had just ended: all zeros is a motion at rest.
    nobody = jnp.full(width, episodes, jnp.int32)
    lanes = dataclasses.replace(jax.tree.map(jnp.zeros_like, ticked(nobody, of(nobody, start), fresh)), episode=nobody)
    tallies = jax.tree.map(lambda leaf: jnp.zeros((episodes, *leaf.shape[1:]), leaf.dtype), fresh)
    carry = (lanes, jnp.int32(0), (start, tallies))
    return lax.while_loop(lambda carry: (carry[1] == 0) | jnp.any(carry[0].episode < episodes), body, carry)[2]


def _settle_some(stepper: Stepper, motion: Any, live: Bool[Array, " W"]) -> Any:
    """Return the motions once enough of the `live` ones rest."""

    def too_few(motion: Any) -> Bool[Array, ""]:
        waits = live & stepper.rests(motion)
        return SHARE * waits.sum() < live.sum()

    return lax.while_loop(too_few, stepper.step, motion)


def _ticked(
    semantics: LeafSemantics,
    stepper: Stepper,
    jumps: JumpTable,
    tree: Int32[Array, " W"],
    chances: Chances | None,
    episode: Int32[Array, " W"],
    world: World,
    tally: Tally,
) -> _Lanes:
    """Tick every tree in its state, carry out the command that runs, and let go."""
    outcomes, exhausted = semantics.outcomes(world), used_up(tally, semantics.task.episode)
    rows = jnp.arange(tree.shape[0])

    def look_up(token: Int32[Array, " W"]) -> Int32[Array, " W"]:
        return resolve(outcomes[0][rows, token], outcomes[1][rows, token], exhausted)

    traced, counts = tally.trace is not None, tally.counts
    ticked = tick_trees(jumps, look_up, tree=tree, trace=traced, counts=counts, halted=int(ACTION))
    command = jnp.where(ticked.acts, command_of(ticked.noted), NO_COMMAND)
    world = reach(world, subgoals_of(ticked.noted))
    # Episodes that do nothing in this tick close an already closed gripper, or open an empty one: no motion.
    idle = jnp.where(world.gripper_open, 0, 1)
    doing = jnp.where(ticked.acts, command, idle)
    fates = None if chances is None else chances.fates
    released = carry_out(Variants(semantics), world, doing, fates, tally.ticks)
    moves = neighbours(semantics.task, released).any(axis=1, keepdims=True)
    motion = stepper.begin(released.world.kits, released.poses, released.present & moves)
    return _Lanes(episode, world, tally, ticked.status, command, ticked.trace, ticked.counts, released, motion)


def _finished(
    semantics: LeafSemantics, stepper: Stepper, lanes: _Lanes, chances: Chances | None
) -> tuple[World, Tally]:
    """Return states and tally after the ticks of all lanes; of those that still settle they mean nothing."""
    task, tick, settled = semantics.task, lanes.tally.ticks, stepper.settled(lanes.motion)
    sane = settled.ok & jnp.isfinite(settled.poses).all(axis=(1, 2))
    command, acts, struck = lanes.command, lanes.command != NO_COMMAND, None
    world = _where(acts & sane, settled_world(task, lanes.released, settled.poses), lanes.world)
    if chances is not None:
        struck = chances.struck(chances.column(command, tick), command)
    traced, counts = lanes.trace, lanes.counts
    travel = driven(lanes.world.base, world.base)
    tally = count_tick(lanes.tally, lanes.status, command, ~sane, task.episode, traced, counts, struck, travel)
    if chances is not None:
        after = _where(tally.ending == Ending.OPEN, between_ticks(world, task, chances.fates, tick), world)
        found = chances.struck_between(task, world, after, tick)
        assert tally.struck is not None
        world, tally = after, dataclasses.replace(tally, struck=tally.struck | found)
    return world, tally


def _where(condition: Bool[Array, " W"], yes: Any, no: Any) -> Any:
    """Return a pytree with the rows of one where a condition holds, and those of the other elsewhere."""
    return jax.tree.map(lambda a, b: jnp.where(condition.reshape(-1, *[1] * (a.ndim - 1)), a, b), yes, no)
