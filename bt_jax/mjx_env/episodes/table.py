"""The transition table: every distinct (state, command, variant) is simulated once.

With deterministic skills an episode is a walk over (state, command) -> state; where things go wrong, a command has several
variants, and there are columns for what happens between two ticks (see `columns`). States get integer ids in the order in
which they are met; those that differ only by which instance of a part is where are one. What leaves return in a state is
computed when it gets its id; of a large vocabulary, only for leaves that trees use, and later for others once they are
ticked there.
Both live on the device, where `evaluator.TableEvaluator` walks over them; the states themselves stay on the host.

The table takes a limited amount of memory. Once that is full it raises `TableFullError` and is to forget what it holds: what
was forgotten is computed again when it is asked for again, with the same result.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int, Int32, UInt

from bt_jax._util.compile_cache import kept_jit
from bt_jax.mjx_env.episodes.codes import OutcomeCodes, TooManyOutcomesError
from bt_jax.mjx_env.episodes.columns import Columns
from bt_jax.mjx_env.episodes.fitness import Misses, target_misses
from bt_jax.mjx_env.episodes.pages import MOST_CELLS, NOWHERE, UNKNOWN, Pages, SparseRows
from bt_jax.mjx_env.interchange import in_order, interchangeable
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import settled_world
from bt_jax.mjx_env.world import World, row_names, take, world_keys
from bt_jax.tasks import Task

__all__ = ["BROKEN", "MEMORY", "UNKNOWN", "Known", "TableFullError", "TransitionTable"]

BROKEN = -2
MEMORY = 4 << 30  # bytes
PARTS = 4  # of the memory; one of them is for the settler's solutions
FIRST_CAPACITY = 2048  # states
GROWTH = 4
BUCKETS = (64, 512, 4096, 32768)
FEW_TOKENS = 256  # of a vocabulary whose leaves are all computed at once
MOST_OUTCOMES = 1 << 22  # that are computed at a time
NAME_BYTES = 150  # of a state's entry in a dict of bytes, besides the bytes


class TableFullError(Exception):
    """The table has no room for what is asked of it. It has to `forget` before it is asked again."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Known:
    """What the table knows, on the device."""

    codes: UInt[Array, "S V"]  # what each leaf returns in each state, as numbers of each leaf
    meanings: Int32[Array, "2 V K"]  # the outcomes that these stand for, in both layers of `LeafSemantics.outcomes`
    following: Pages  # for each state and column the next state, or UNKNOWN, or BROKEN where the simulation diverged
    base: Float32[Array, "S 2"] | None = None  # where a base stands in each state

    def outcomes(
        self, state: Int32[Array, " E"], token: Int32[Array, " E"]
    ) -> tuple[Int32[Array, " E"], Int32[Array, " E"]]:
        """Return the outcomes of leaves in states, in both layers, or NOT_COMPUTED."""
        _, tokens, meanings = self.meanings.shape
        code = self.codes.reshape(-1)[state * tokens + token].astype(jnp.int32)
        first, second = self.meanings.reshape(2, -1)
        at = token * meanings + code
        return first[at], second[at]


class TransitionTable:
    """States, outcomes and transitions met so far, in at most `memory` bytes, the settler's solutions included, but never
    less than one episode takes. `swappable`: objects that nothing tells apart (see `interchangeable`).
    Where things happen to single instances, no objects are.
    """

    def __init__(self, semantics: LeafSemantics, physics: Physics, *, memory: int = MEMORY) -> None:
        self.semantics = semantics
        self.settler = Settler(semantics.task, physics, memory=memory // PARTS)
        self.columns = Columns(semantics)
        self.swappable = () if _names_instances(semantics.task) else interchangeable(semantics)
        self.num_states = 0
        self.num_transitions = 0  # one that was forgotten and is simulated again counts again
        self.num_broken = 0
        self.num_restarts = 0
        self.num_columns = self.columns.extent.num
        self._capacities = self._growing(memory - memory // PARTS)
        self._ids: dict[bytes, int] = {}
        self._rows: _Rows | None = None
        capacity = next(self._capacities)
        self._live = semantics.everything
        self._numbers = OutcomeCodes(len(semantics.vocabulary), _code_type(semantics))
        self._meanings = jax.device_put(self._numbers.meanings)
        self._codes = jax.device_put(np.zeros((capacity, len(semantics.vocabulary)), self._numbers.dtype))
        drives = semantics.task.robot.base is not None
        self._bases = jax.device_put(np.zeros((capacity, 2), np.float32)) if drives else None
        self._following = SparseRows(self.num_columns, capacity)

    def _growing(self, memory: int) -> Iterator[int]:
        """Yield the capacities, in states, through which the table grows. While it is copied from one to the next, both take
        memory."""
        tokens = len(self.semantics.vocabulary)
        whole = memory // self._bytes_per_state
        most = min(MOST_CELLS // tokens, SparseRows.most_states(self.num_columns))
        capacity = max(min(FIRST_CAPACITY, whole), _states_of_an_episode(self.semantics) + BUCKETS[0])
        yield capacity
        while (larger := min(GROWTH * capacity, whole - capacity, most)) > capacity:
            yield larger
            capacity = larger

    @property
    def _bytes_per_state(self) -> int:
        """How much memory the room for one state takes, host and device together."""
        task, tokens = self.semantics.task, len(self.semantics.vocabulary)
        boxes, kits, subgoals = len(task.objects), len(task.kits), len(task.subgoals)
        unseen = 0 if task.faults is None else boxes
        base = 0 if task.robot.base is None else 2
        name = NAME_BYTES + 4 * (2 + 3 * kits + 7 * boxes + subgoals + unseen + base)
        row = (
            4 * (1 + 2 * base + 3 * kits + 7 * boxes + 2 * len(task.targets))
            + len(task.targets)
            + 2
            + subgoals
            + unseen
        )
        code = np.dtype(_code_type(self.semantics)).itemsize
        return name + row + code * tokens + SparseRows.bytes_per_state(self.num_columns)

    @property
    def nbytes(self) -> int:
        """The memory that the table takes, host and device together, without the settler's solutions."""
        rows = [] if self._rows is None else jax.tree.leaves(self._rows)
        names = sum(NAME_BYTES + len(name) for name in self._ids)
        return names + sum(leaf.nbytes for leaf in rows) + self._codes.nbytes + self._following.nbytes

    @property
    def known(self) -> Known:
        """What the table knows now. The next call of `ids` or `learn` takes these arrays over."""
        return Known(self._codes, self._meanings, self._following.pages, self._bases)

    def use(self, tokens: Int[np.ndarray, "*m"]) -> None:
        """Compute what leaves with these tokens return, from now on, and of a large vocabulary no others."""
        vocabulary = self.semantics.vocabulary
        if len(vocabulary) > FEW_TOKENS:
            used = np.zeros(len(vocabulary), bool)
            used[tokens] = True
            self._live = self.semantics.select(np.flatnonzero(used))

    def forget(self) -> None:
        """Forget all states; their ids mean nothing from now on. The memory is kept for new ones."""
        self.num_states = 0
        self.num_restarts += 1
        self._ids = {}
        self._numbers = OutcomeCodes(len(self.semantics.vocabulary), self._numbers.dtype)
        self._following.forget()

    @property
    def _known(self) -> _Rows:
        if self._rows is None:
            raise LookupError("the table has no states yet")
        return self._rows

    def worlds(self, ids: Int32[np.ndarray, " S"]) -> World:
        """Return the states with these ids (NumPy), swappable objects in order."""
        return take(self._known.world, ids)

    def misses(self, ids: Int32[np.ndarray, " S"]) -> Misses:
        """Return how far the targets are from being met in these states."""
        known = self._known.misses
        return Misses(known.distance[ids], known.turn[ids], known.met[ids])

    def reached(self, ids: Int32[np.ndarray, " S"]) -> Bool[np.ndarray, "S subgoals"]:
        """Return which of the task's subgoals were reached on the way to these states."""
        return self._known.world.reached[ids]

    def ids(self, world: World) -> Int32[np.ndarray, " S"]:
        """Return the ids of snapped states (NumPy); new ones are added in the order in which they appear."""
        known, world = self._ids, in_order(world, self.swappable)
        ids = np.array([known.setdefault(name, len(known)) for name in row_names(world_keys(world))], np.int32)
        if len(known) > self.num_states:
            new = np.flatnonzero(ids >= self.num_states)
            self._append(take(world, new[np.unique(ids[new], return_index=True)[1]]))
        return ids

    def learn(self, states: Int32[np.ndarray, " n"], columns: Int32[np.ndarray, " n"]) -> None:
        """Simulate the columns in the states, as one batch, and enter where they lead. The pairs must be distinct."""
        acts, following = columns < self.columns.extent.subgoals, np.zeros(len(states), np.int32)
        if acts.any():
            following[acts] = self._simulated(states[acts], columns[acts])
        for rows in self.columns.parts(columns):
            following[rows] = self.ids(self.columns.happened(self.worlds(states[rows]), columns[rows]))
        self._reserve_pages(states, columns)
        for part in _parts(len(states)):
            entered = states[part.rows], columns[part.rows], following[part.rows]
            self._following.enter(*entered, size=part.size)

    def _simulated(self, states: Int32[np.ndarray, " n"], columns: Int32[np.ndarray, " n"]) -> Int32[np.ndarray, " n"]:
        """Return the ids of the states to which commands lead, or BROKEN."""
        released = self.columns.released(self.worlds(states), columns)
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
        count = world.held.shape[0]
        self._reserve_states(self.num_states + count)
        tokens = len(self.semantics.vocabulary)
        for part in _parts(count, room=self._codes.shape[0] - self.num_states, tokens=tokens):
            new, start = take(world, part.rows), self.num_states
            self._remember(_Rows(new, target_misses(self.semantics.task, new)), start)
            self._codes = _write(self._codes, self._coded(new, part.size), np.int32(start))
            if new.base is not None and self._bases is not None:
                padded = np.zeros((part.size, 2), np.float32)
                padded[: len(new.base)] = new.base
                self._bases = _write(self._bases, padded, np.int32(start))
            self.num_states += new.held.shape[0]

    def complete(self, states: Int32[np.ndarray, " n"]) -> None:
        """Compute what the leaves in use return in states where that is not known."""
        for part in _parts(len(states), tokens=len(self.semantics.vocabulary)):
            rows = np.full(part.size, NOWHERE, np.int32)  # which is dropped
            rows[: len(states[part.rows])] = states[part.rows]
            self._codes = _merge(self._codes, self._coded(self.worlds(states[part.rows]), part.size), rows)

    def _coded(self, world: World, size: int) -> UInt[np.ndarray, "size V"]:
        """Return the outcomes in states as numbers, with rows of zeros behind them."""
        tokens = self._live.tokens
        codes = np.zeros((size, len(self.semantics.vocabulary)), self._codes.dtype)
        try:
            codes[: world.held.shape[0], tokens], are_new = self._numbers.encode(
                self.semantics.outcomes(world, self._live), tokens
            )
        except TooManyOutcomesError as error:
            raise TableFullError from error
        if are_new:
            self._meanings = jax.device_put(self._numbers.meanings)
        return codes

    def _remember(self, rows: _Rows, start: int) -> None:
        if self._rows is None:
            self._rows = jax.tree.map(lambda leaf: _lengthened(leaf[:0], self._codes.shape[0]), rows)
        for leaf, more in zip(jax.tree.leaves(self._rows), jax.tree.leaves(rows), strict=True):
            leaf[start : start + len(more)] = more

    def _reserve_states(self, states: int) -> None:
        while states + BUCKETS[0] > self._codes.shape[0]:  # the last part is padded to a bucket
            self._grow()

    def _reserve_pages(self, states: Int32[np.ndarray, " n"], columns: Int32[np.ndarray, " n"]) -> None:
        while not self._following.has_room(states, columns):
            self._grow()

    def _grow(self) -> None:
        capacity = next(self._capacities, None)
        if capacity is None:
            raise TableFullError
        more = ((0, capacity - self._codes.shape[0]), (0, 0))
        self._codes = jnp.pad(self._codes, more)
        self._bases = None if self._bases is None else jnp.pad(self._bases, more)
        self._following.grow(capacity)
        if self._rows is not None:
            self._rows = jax.tree.map(lambda leaf: _lengthened(leaf, capacity), self._rows)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Rows:
    """What the host keeps of each state; there may be room for more states behind the last."""

    world: World
    misses: Misses


def _lengthened(array: np.ndarray, length: int) -> np.ndarray:
    longer = np.empty((length, *array.shape[1:]), array.dtype)
    longer[: len(array)] = array
    return longer


def _states_of_an_episode(semantics: LeafSemantics) -> int:
    """Return the most states that one episode can visit."""
    between = 0 if semantics.task.faults is None else 2
    return 1 + semantics.task.episode.max_ticks * (1 + semantics.num_ticked + between)


def _names_instances(task: Task) -> bool:
    """Return whether faults happen to one instance of a part and not to another."""
    return task.faults is not None and bool(task.faults.hide or task.faults.move or task.faults.take)


def _code_type(semantics: LeafSemantics) -> type[np.unsignedinteger]:
    """Return what numbers the outcomes of a leaf in all states of one episode."""
    return np.uint8 if _states_of_an_episode(semantics) < 1 << 8 else np.uint16


class _Part(NamedTuple):
    rows: slice
    size: int


def _parts(count: int, *, room: int = MOST_CELLS, tokens: int = 1) -> Iterator[_Part]:
    """Cut `count` rows into parts whose padded sizes are among a few, so that few shapes are compiled. Padded, all of them
    end within `room` rows; none has more than MOST_OUTCOMES cells of rows with `tokens`."""
    buckets = [bucket for bucket in BUCKETS if bucket * tokens <= MOST_OUTCOMES] or BUCKETS[:1]
    done = 0
    while done < count:
        left = count - done
        padded = [bucket for bucket in buckets if left <= bucket <= room - done]
        size = padded[0] if padded else max(bucket for bucket in buckets if bucket <= left)
        yield _Part(slice(done, min(done + size, count)), size)
        done += size


@kept_jit(donate_argnums=(0,))
def _write(codes: Array, piece: Array, start: Array) -> Array:
    return jax.lax.dynamic_update_slice_in_dim(codes, piece, start, axis=0)


@kept_jit(donate_argnums=(0,))
def _merge(codes: Array, piece: Array, rows: Array) -> Array:
    """Enter numbers in place of zeros; a number that is there already is the same."""
    return codes.at[rows].max(piece, mode="drop")
