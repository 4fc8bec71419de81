"""A sparse matrix of states and commands: where commands lead.

Of the commands that a task has, few are ever asked for in one state. A row is therefore cut into blocks, and a block gets a
page of memory once one of its commands is entered; an index says which. So a look-up is two reads without a search, on any
number of rows at once, and memory grows with what was entered instead of with states times commands.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int, Int32

from bt_jax._util.compile_cache import kept_jit

__all__ = ["UNKNOWN", "Pages", "SparseRows"]

UNKNOWN = -1
EMPTY = 0  # the page of every block of which nothing is known
PAGE_BITS = 6
PAGE = 1 << PAGE_BITS  # commands in a block
MOST_CELLS = NOWHERE = np.iinfo(np.int32).max  # that an index can number; an index that is dropped


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Pages:
    """The matrix on the device. Page EMPTY holds UNKNOWN alone."""

    index: Int32[Array, "S B"]  # page of each block of each state
    pages: Int32[Array, "P 64"]

    def at(self, state: Int32[Array, " E"], command: Int32[Array, " E"]) -> Int32[Array, " E"]:
        """Return what was entered, or UNKNOWN."""
        page = self.index.reshape(-1)[state * self.index.shape[1] + (command >> PAGE_BITS)]
        return self.pages.reshape(-1)[(page << PAGE_BITS) + (command & (PAGE - 1))]


class SparseRows:
    """The matrix with a copy of its index on the host, which knows where new entries go. There is room for `capacity` states
    and for one page for each: many states are asked for nothing, since an episode ends there."""

    def __init__(self, num_commands: int, capacity: int) -> None:
        self.blocks = -(-num_commands // PAGE)
        self.capacity = capacity  # states
        self.num_pages = 1
        self._index = np.full((capacity, self.blocks), EMPTY, np.int32)
        pages = np.full((1 + capacity, PAGE), UNKNOWN, np.int32)
        self.pages = Pages(jax.device_put(self._index.copy()), jax.device_put(pages))

    @staticmethod
    def most_states(num_commands: int) -> int:
        """Return for how many states an index of 32 bits can number all blocks and all entries of pages."""
        return min(MOST_CELLS // -(-num_commands // PAGE), MOST_CELLS // PAGE - 1)

    @staticmethod
    def bytes_per_state(num_commands: int) -> int:
        """Return the memory that the room for one state takes, host and device together."""
        return 2 * 4 * -(-num_commands // PAGE) + 4 * PAGE

    @property
    def nbytes(self) -> int:
        """The memory of all arrays, host and device together."""
        return self._index.nbytes + self.pages.index.nbytes + self.pages.pages.nbytes

    def has_room(self, states: Int32[np.ndarray, " n"], commands: Int32[np.ndarray, " n"]) -> bool:
        """Return whether there are pages enough to enter commands in states."""
        room = self.pages.pages.shape[0] - self.num_pages
        return len(states) <= room or len(self._new_blocks(states, commands)) <= room

    def grow(self, capacity: int) -> None:
        """Make room for that many states."""
        extra = capacity - self.capacity
        self._index = np.concatenate([self._index, np.full((extra, self.blocks), EMPTY, np.int32)])
        grows = ((0, extra), (0, 0))
        index = jnp.pad(self.pages.index, grows, constant_values=EMPTY)
        self.pages = Pages(index, jnp.pad(self.pages.pages, grows, constant_values=UNKNOWN))
        self.capacity = capacity

    def forget(self) -> None:
        """Take all entries out."""
        self.num_pages = 1
        self._index[:] = EMPTY
        self.pages = _emptied(self.pages)

    def enter(
        self,
        states: Int32[np.ndarray, " n"],
        commands: Int32[np.ndarray, " n"],
        following: Int32[np.ndarray, " n"],
        size: int,
    ) -> None:
        """Enter where the commands lead in the states; the pairs must be distinct. `size` >= n is the compiled size."""
        new = self._new_blocks(states, commands)
        self._index.reshape(-1)[new] = np.arange(self.num_pages, self.num_pages + len(new))
        self.num_pages += len(new)
        block = states.astype(np.int64) * self.blocks + commands // PAGE
        page = self._index.reshape(-1)[block]
        entries = np.full((4, size), NOWHERE, np.int32)
        entries[:, : len(states)] = block, page, page * PAGE + commands % PAGE, following
        self.pages = _enter(self.pages, entries)

    def _new_blocks(self, states: Int32[np.ndarray, " n"], commands: Int32[np.ndarray, " n"]) -> Int[np.ndarray, " m"]:
        """Return the blocks that have no page yet, each once, numbered through all states."""
        blocks = np.unique(states.astype(np.int64) * self.blocks + commands // PAGE)
        return blocks[self._index.reshape(-1)[blocks] == EMPTY]


@kept_jit(donate_argnums=(0,))
def _enter(known: Pages, entries: Int32[Array, "4 n"]) -> Pages:
    block, page, at, value = entries
    index = known.index.reshape(-1).at[block].set(page, mode="drop").reshape(known.index.shape)
    return Pages(index, known.pages.reshape(-1).at[at].set(value, mode="drop").reshape(known.pages.shape))


@kept_jit(donate_argnums=(0,))
def _emptied(known: Pages) -> Pages:
    return Pages(jnp.full_like(known.index, EMPTY), jnp.full_like(known.pages, UNKNOWN))
