"""How a command may go: each has variants, numbered from 0, of which the first is without faults.

The continuous error of a `place` stands in the table as NUM_ERRORS joint quasi-random draws of x, y and turn: the first
points of Sobol's sequence in three dimensions, unscrambled, shifted modulo 1 by an offset of the place's own (Cranley and
Patterson 1976) and mapped by the quantile of the normal distribution. Over places, each draw has that distribution: 16
draws that all places shared would succeed more or less often than it, by up to a sixteenth.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import zlib
from statistics import NormalDist

import numpy as np
from jaxtyping import Float32, Int32

from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Mishaps
from bt_jax.mjx_env.world import Array, namespace
from bt_jax.tasks import Faults, Task
from bt_jax.tasks.faults import FAULTS

__all__ = ["FRACTIONS", "JAMS", "NUM_ERRORS", "SLIPS", "Variants", "affected", "bit", "num_errors", "unit_errors"]

NUM_ERRORS = 16
JAMS, SLIPS = 1, 2  # variants of every command but `place`, which has its errors, then jams, then drops
FRACTIONS = (0.2, 0.5, 0.8)  # of the way, after which what is carried may drop

LEAST = 1e-4  # of a probability whose quantile is taken: errors end at 3.7 spreads
SOBOL = (
    (0, 8, 12, 4, 6, 14, 10, 2, 3, 11, 15, 7, 5, 13, 9, 1),
    (0, 8, 4, 12, 6, 14, 2, 10, 5, 13, 1, 9, 3, 11, 7, 15),
    (0, 8, 4, 12, 10, 2, 14, 6, 15, 7, 11, 3, 5, 13, 1, 9),
)


def bit(fault: str) -> int:
    """Return the bit that stands for a fault, a key of `tasks.faults.FAULTS`, where episodes count which ones happened."""
    return 1 << list(FAULTS).index(fault)


def affected(task: Task) -> np.ndarray:
    """Return to which of `Task.kinds` faults happen, bool[kinds]."""
    chosen = () if task.faults is None else task.faults.objects
    return np.array([not chosen or kind in chosen for kind in task.kinds], bool)


def num_errors(faults: Faults | None) -> int:
    """Return how many variants of a `place` let go of the object near the goal instead of over it."""
    return NUM_ERRORS if faults is not None and (faults.place_spread or faults.turn_spread) else 0


@functools.lru_cache(maxsize=1 << 16)
def unit_errors(place: str) -> Float32[np.ndarray, "16 3"]:
    """Return the draws of a place, as a tree writes it, from a normal distribution in three dimensions."""
    shift = np.random.default_rng(zlib.crc32(place.encode())).random(3)
    points = np.clip((np.array(SOBOL).T / NUM_ERRORS + shift) % 1, LEAST, 1 - LEAST)
    return np.array([[NormalDist().inv_cdf(u) for u in point] for point in points.tolist()], np.float32)


@dataclasses.dataclass(frozen=True)
class Variants:
    """The variants of all commands of a vocabulary, side by side in the columns of the transition table: those of the first
    command, then those of the second, and so on. Without faults, every command has one."""

    semantics: LeafSemantics

    @functools.cached_property
    def classes(self) -> Int32[np.ndarray, " commands"]:
        """What decides with which other commands one shares its fate: open_gripper, close_gripper, `pick` of each of
        `Task.kinds`, then `place` of each of them; -1 for the others, with which nothing goes wrong."""
        task = self.semantics.task
        kinds = [task.kinds.index(task.thing(name).part or name) for name in self.semantics.names]
        picks = [2 + kind for kind in kinds]
        places = [2 + len(task.kinds) + kinds[name] for name in self.semantics.place_name]
        return np.array([0, 1, *picks, *self._num_safe * [-1], *places], np.int32)

    @property
    def _num_safe(self) -> int:
        """How many commands, between the picks and the places, neither grip nor let go."""
        return self.semantics.first_place - 2 - self.semantics.num_picks

    @functools.cached_property
    def counts(self) -> Int32[np.ndarray, " commands"]:
        """How many variants each command has."""
        semantics, faults = self.semantics, self.semantics.task.faults
        if faults is None:
            return np.ones(len(semantics.commands), np.int32)
        of_place = 1 + num_errors(faults) + 1 + len(FRACTIONS)
        each = [2, semantics.num_picks, self._num_safe, len(semantics.places)]
        return np.repeat(np.array([2, 3, 1, of_place], np.int32), each)

    @functools.cached_property
    def first(self) -> Int32[np.ndarray, " commands"]:
        """The column of the first variant of each command."""
        return (np.cumsum(self.counts) - self.counts).astype(np.int32)

    @functools.cached_property
    def command(self) -> Int32[np.ndarray, " columns"]:
        """The command of each column."""
        return np.repeat(np.arange(len(self.counts), dtype=np.int32), self.counts)

    @functools.cached_property
    def bits(self) -> Int32[np.ndarray, " columns"]:
        """The fault that happens in each column, as a bit (see `bit`)."""
        variant = np.arange(len(self.command)) - self.first[self.command]
        mishaps = self.mishaps(self.command, variant.astype(np.int32))
        found = np.where(mishaps.jams, bit("jam"), 0) | np.where(mishaps.slips, bit("slip"), 0)
        found |= np.where(mishaps.share < 1, bit("drop"), 0)
        return (found | np.where(mishaps.error.any(axis=1), bit("misplace"), 0)).astype(np.int32)

    @functools.cached_property
    def unit(self) -> Float32[np.ndarray, "places 16 3"]:
        """The draws of each place."""
        each = [unit_errors(str(place)) for place in self.semantics.places]
        return np.array(each, np.float32).reshape(-1, NUM_ERRORS, 3)

    def mishaps(
        self, command: Int32[Array, " S"], variant: Int32[Array, " S"], unit: Float32[Array, "S 3"] | None = None
    ) -> Mishaps:
        """Return what goes wrong in a variant of each of S commands. `unit`: draws of a normal distribution instead of the
        quasi-random ones, where the object is not dropped."""
        xp, semantics, faults = namespace(command), self.semantics, self.semantics.task.faults or Faults()
        errors = num_errors(faults)
        is_place = command >= semantics.first_place
        is_pick = (command >= 2) & (command < 2 + semantics.num_picks)
        fall = variant - errors - 2  # index of the fraction
        drops = is_place & (fall >= 0)
        strays = is_place & (variant >= 1) & (variant <= errors)
        fractions = xp.asarray(np.array(FRACTIONS, np.float32))[xp.clip(fall, 0, len(FRACTIONS) - 1)]
        if unit is None and errors and semantics.places:
            place = xp.maximum(command - semantics.first_place, 0)
            unit = xp.asarray(self.unit)[place, xp.clip(variant - 1, 0, NUM_ERRORS - 1)]
        elif unit is None:
            unit = xp.zeros((command.shape[0], 3), np.float32)
        turn_spread = math.radians(faults.turn_spread)
        spread = np.array([[faults.place_spread, faults.place_spread, turn_spread]], np.float32)
        return Mishaps(
            slips=is_pick & (variant == SLIPS),
            jams=xp.where(is_place, variant == errors + 1, variant == JAMS),
            share=xp.where(drops, fractions, np.float32(1)),
            error=xp.where(strays[:, None], unit * spread, np.float32(0)),
        )
