"""The transition table: every distinct (state, command) is simulated once.

With deterministic skills an episode is a walk over (state, command) -> state. States get integer ids in the order in which
they are met; what every leaf returns in a state is computed when it gets its id. Both tables live on the device, where
`evaluator.TableEvaluator` walks over them; the states themselves stay on the host.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax.mjx_env.episodes.fitness import target_distances
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act, reach, settled_world
from bt_jax.mjx_env.world import World, row_names, take, world_keys

__all__ = ["BROKEN", "UNKNOWN", "TransitionTable"]

UNKNOWN, BROKEN = -1, -2
FIRST_CAPACITY = 2048
GROWTH = 4
BUCKETS = (64, 512, 4096, 32768)
NOWHERE = np.iinfo(np.int32).max  # an index that is dropped


class TransitionTable:
    """States, outcomes and transitions met so far.

    `outcomes[layer, state, token]` is as in `LeafSemantics.outcomes`; `following[state * C + command]` is the next state, or
    UNKNOWN, or BROKEN where the simulation diverged. The last commands, one for each subgoal that the tree has to tick, lead
    to the same state with that subgoal reached.
    """

    outcomes: Int32[Array, "2 S V"]
    following: Int32[Array, " SC"]

    def __init__(self, semantics: LeafSemantics, physics: Physics) -> None:
        self.semantics = semantics
        self.settler = Settler(semantics.task, physics)
        self.num_states = 0
        self.num_transitions = 0
        self.num_broken = 0
        self.num_commands = len(semantics.commands) + semantics.num_ticked
        self._ids: dict[bytes, int] = {}
        self._rows: _Rows | None = None
        self.outcomes = jax.device_put(np.zeros((2, FIRST_CAPACITY, len(semantics.vocabulary)), np.int32))
        self.following = jax.device_put(np.full(FIRST_CAPACITY * self.num_commands, UNKNOWN, np.int32))

    @property
    def _known(self) -> _Rows:
        if self._rows is None:
            raise LookupError("the table has no states yet")
        return self._rows

    def worlds(self, ids: Int32[np.ndarray, " S"]) -> World:
        """Return the states with these ids (NumPy)."""
        return take(self._known.world, ids)

    def distance(self, ids: Int32[np.ndarray, " S"]) -> Float32[np.ndarray, "S targets"]:
        """Return the distances of the targets' objects in these states, metres."""
        return self._known.distance[ids]

    def reached(self, ids: Int32[np.ndarray, " S"]) -> Bool[np.ndarray, "S subgoals"]:
        """Return which of the task's subgoals were reached on the way to these states."""
        return self._known.world.reached[ids]

    def ids(self, world: World) -> Int32[np.ndarray, " S"]:
        """Return the ids of snapped states (NumPy); new ones are added in the order in which they appear."""
        known = self._ids
        ids = np.array([known.setdefault(name, len(known)) for name in row_names(world_keys(world))], np.int32)
        if len(known) > self.num_states:
            new = np.flatnonzero(ids >= self.num_states)
            self._append(take(world, new[np.unique(ids[new], return_index=True)[1]]))
        return ids

    def learn(self, states: Int32[np.ndarray, " n"], commands: Int32[np.ndarray, " n"]) -> None:
        """Simulate the commands in the states, as one batch, and enter where they lead. The pairs must be distinct."""
        subgoal = commands - len(self.semantics.commands)
        acts, following = subgoal < 0, np.zeros(len(states), np.int32)
        if acts.any():
            following[acts] = self._simulated(states[acts], commands[acts])
        if not acts.all():
            following[~acts] = self.ids(reach(self.worlds(states[~acts]), np.int32(1) << subgoal[~acts]))
        index = states * self.num_commands + commands
        for part in _parts(len(index)):
            at, values = np.full(part.size, NOWHERE, np.int32), np.zeros(part.size, np.int32)
            count = len(index[part.rows])
            at[:count], values[:count] = index[part.rows], following[part.rows]
            self.following = _enter(self.following, at, values)

    def _simulated(self, states: Int32[np.ndarray, " n"], commands: Int32[np.ndarray, " n"]) -> Int32[np.ndarray, " n"]:
        """Return the ids of the states to which commands lead, or BROKEN."""
        released = act(self.semantics, self.worlds(states), commands)
        poses, ok = self.settler.settle(released)
        following = np.full(len(states), BROKEN, np.int32)
        if ok.any():
            if not ok.all():
                released, poses = jax.tree.map(lambda leaf: leaf[ok], (released, poses))
            following[ok] = self.ids(settled_world(self.semantics.task, released, poses))
        self.num_transitions += len(states)
        self.num_broken += int(np.sum(~ok))
        return following

    def _append(self, world: World) -> None:
        rows = _Rows(world, target_distances(self.semantics.task, world))
        self._rows = rows if self._rows is None else self._rows.followed_by(rows, self.num_states)
        outcomes = self.semantics.outcomes(world)
        for part in _parts(world.held.shape[0]):
            self._reserve(self.num_states + part.size)
            count = outcomes[:, part.rows].shape[1]
            piece = np.zeros((2, part.size, outcomes.shape[2]), np.int32)
            piece[:, :count] = outcomes[:, part.rows]
            self.outcomes = _write(self.outcomes, piece, np.int32(self.num_states))
            self.num_states += count

    def _reserve(self, states: int) -> None:
        capacity = self.outcomes.shape[1]
        if states <= capacity:
            return
        while capacity < states:
            capacity *= GROWTH
        extra = capacity - self.outcomes.shape[1]
        self.outcomes = jnp.pad(self.outcomes, ((0, 0), (0, extra), (0, 0)))
        self.following = jnp.pad(self.following, (0, extra * self.num_commands), constant_values=UNKNOWN)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Rows:
    """What the host keeps of each state; there may be room for more states behind the last."""

    world: World
    distance: Float32[np.ndarray, "S targets"]

    def followed_by(self, other: _Rows, count: int) -> _Rows:
        """Return the first `count` rows with the other ones behind them, in place if there is room."""
        leaves, structure = jax.tree.flatten(self)
        end = count + len(other.distance)
        if end > len(self.distance):
            leaves = [np.resize(leaf, (GROWTH * end, *leaf.shape[1:])) for leaf in leaves]
        for leaf, more in zip(leaves, jax.tree.leaves(other), strict=True):
            leaf[count:end] = more
        return jax.tree.unflatten(structure, leaves)


class _Part(NamedTuple):
    rows: slice
    size: int


def _parts(count: int) -> Iterator[_Part]:
    """Cut `count` rows into parts whose padded sizes are among a few, so that few shapes are compiled."""
    done = 0
    while done < count:
        size = next((bucket for bucket in BUCKETS if bucket >= count - done), BUCKETS[-1])
        yield _Part(slice(done, min(done + size, count)), size)
        done += size


@kept_jit(donate_argnums=(0,))
def _write(outcomes: Array, piece: Array, start: Array) -> Array:
    return jax.lax.dynamic_update_slice_in_dim(outcomes, piece, start, axis=1)


@kept_jit(donate_argnums=(0,))
def _enter(following: Array, index: Array, values: Array) -> Array:
    return following.at[index].set(values, mode="drop")
