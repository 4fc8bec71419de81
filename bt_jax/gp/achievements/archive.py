"""The trees worth keeping: the best of each set of achievements (after MAP-Elites, Mouret and Clune 2015)."""

from __future__ import annotations

import dataclasses

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int, Int32, UInt64

from bt_jax.encoding.arrays import Trees

__all__ = ["PER_KEY", "Archive", "keys_of"]

PER_KEY = 2
FIELD = 4  # entries of which the fittest becomes a parent


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Archive:
    """The `PER_KEY` best trees of each set of achievements, ordered by set and then by fitness (NumPy)."""

    trees: Trees  # [E, N]
    fitness: Float32[np.ndarray, " E"]
    keys: UInt64[np.ndarray, " E"]  # the achievements as bits
    missed: Float32[np.ndarray, "E A"]  # by how much fitness fell with what each achievement lacks

    @staticmethod
    def empty(num_nodes: int, achievements: int) -> Archive:
        """Return an archive without trees."""
        trees = Trees(np.zeros((0, num_nodes), np.int16), np.zeros((0, num_nodes), np.uint8))
        return Archive(trees, np.zeros(0, np.float32), np.zeros(0, np.uint64), np.zeros((0, achievements), np.float32))

    def __len__(self) -> int:
        return len(self.fitness)

    def entrants(
        self, fitness: Float32[np.ndarray, " M"], keys: UInt64[np.ndarray, " M"], *, drift: bool
    ) -> Int32[np.ndarray, " _"]:
        """Return which of M trees the archive would take, each on its own; with `drift`, also those that only equal the tree
        they replace."""
        if not len(self):
            return np.arange(len(fitness), dtype=np.int32)
        place = np.searchsorted(self.keys, keys) + PER_KEY - 1  # that of the worst which is kept, if there are so many
        inside = np.minimum(place, len(self) - 1)
        full = (place < len(self)) & (self.keys[inside] == keys)
        least = self.fitness[inside]
        return np.flatnonzero(~full | (fitness > least) | (drift & (fitness == least))).astype(np.int32)

    def with_(self, others: Archive) -> Archive:
        """Return the archive after the trees of another, in any order, have competed for their places; of equals, those of
        the other stay."""
        both = jax.tree.map(lambda new, old: np.concatenate([new, old]), others, self)
        trees, fitness, keys = both.trees, both.fitness, both.keys
        _, once = np.unique(np.concatenate(_fields(trees), axis=1), axis=0, return_index=True)
        once = np.sort(once)
        order = once[np.lexsort((-fitness[once], keys[once]))]
        keys = keys[order]
        rank = np.arange(len(order)) - np.searchsorted(keys, keys)
        return both.at(order[rank < PER_KEY])

    def at(self, rows: Int[np.ndarray, " _"]) -> Archive:
        """Return some of the entries."""
        return Archive(self.trees[rows], self.fitness[rows], self.keys[rows], self.missed[rows])

    def achieved(self, achievements: int) -> Bool[np.ndarray, "E A"]:
        """Return what each tree achieves."""
        return (self.keys[:, None] >> np.arange(achievements, dtype=np.uint64) & np.uint64(1)).astype(bool)

    def parents(self, rng: np.random.Generator, shape: tuple[int, int]) -> Int32[np.ndarray, "2 M"]:
        """Draw entries that offspring descend from: of ten, four achieve the most, three are the fittest of four entries,
        and three are any."""
        achieved = np.bitwise_count(self.keys).astype(np.float64)
        most = np.lexsort((self.fitness, achieved))[-1]
        field = rng.integers(len(self), size=(FIELD, *shape))
        fittest = np.take_along_axis(field, self.fitness[field].argmax(axis=0)[None], axis=0)[0]
        draw = rng.random(shape)
        return np.where(draw < 0.4, most, np.where(draw < 0.7, fittest, field[0])).astype(np.int32)


def keys_of(achieved: Bool[np.ndarray, "M A"]) -> UInt64[np.ndarray, " M"]:
    """Return sets of achievements as bits."""
    bits = np.uint64(1) << np.arange(achieved.shape[1], dtype=np.uint64)
    return np.where(achieved, bits, np.uint64(0)).sum(axis=1, dtype=np.uint64)


def _fields(trees: Trees) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(trees.tokens), np.asarray(trees.sizes)
