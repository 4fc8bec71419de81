"""The columns of the transition table: everything that leads from one state to the next.

First the variants of all commands, then the subgoals that a tree ticks, then what a person does between two ticks, and what
gets out of sight. Without faults that is one column for each command, and the subgoals.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator

import jax
import numpy as np
from jaxtyping import Int32

from bt_jax.mjx_env.episodes.rules import Tally
from bt_jax.mjx_env.faults.events import (
    is_away,
    num_person_events,
    num_sight_events,
    person_acts,
    person_bits,
    sight_bits,
    sight_changes,
)
from bt_jax.mjx_env.faults.fates import Fates, nothing_wrong
from bt_jax.mjx_env.faults.variants import Variants, bit
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Released, act, reach
from bt_jax.mjx_env.world import Array, World, namespace
from bt_jax.tasks import Task

__all__ = ["Chances", "Columns", "Extent", "tick_of"]


@dataclasses.dataclass(frozen=True)
class Extent:
    """Where in the columns what begins; hashable, since compiled code takes it as it is."""

    num: int
    subgoals: int
    num_ticked: int
    person: int
    sight: int


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Chances:
    """The fates of E episodes, and how to find the columns that they mean."""

    fates: Fates
    first: Int32[Array, " commands"]  # see `Variants`
    classes: Int32[Array, " commands"]
    bits: Int32[Array, " columns"]
    person_bits: Int32[Array, " persons"]
    sight_bits: Int32[Array, " sights"]

    def column(self, command: Int32[Array, " E"], tick: Int32[Array, " E"]) -> Int32[Array, " E"]:
        """Return the column of the command that each episode runs in its tick, counted from 0."""
        return self.first[command] + self.fates.variant_of(tick, self.classes[command])

    def struck(self, column: Int32[Array, " E"], command: Int32[Array, " E"]) -> Int32[Array, " E"]:
        """Return the faults that happen in a column, as bits."""
        xp, kinds = namespace(command), self.fates.heavy.shape[1]
        of_class = self.classes[command]
        heavy = (of_class >= 2) & self.fates.heavy[np.arange(command.shape[0]), xp.maximum(of_class - 2, 0) % kinds]
        return self.bits[column] | xp.where(heavy, np.int32(bit("heavy")), np.int32(0))

    def between(self, extent: Extent, tick: Int32[Array, " E"]) -> Iterator[tuple[Array, Array, Array]]:
        """Yield what happens after the tick of each episode, counted from 0, one after the other: whether anything does, its
        column, and the fault that it is, as a bit."""
        rows, fates = np.arange(tick.shape[0]), self.fates
        for first, events, bits in (
            (extent.person, fates.person, self.person_bits),
            (extent.sight, fates.sight, self.sight_bits),
        ):
            event = events[rows, tick].astype(np.int32)
            yield event > 0, np.int32(first) + event, bits[event]

    def struck_between(self, task: Task, before: World, after: World, tick: Int32[Array, " E"]) -> Int32[Array, " E"]:
        """Return the faults that happened after the tick of each episode, counted from 0, as bits: those that have changed
        the state, first what a person does, then what gets out of sight."""
        assert before.unseen is not None
        assert after.unseen is not None
        xp, rows, zero = namespace(tick), np.arange(tick.shape[0]), np.int32(0)
        moved = (before.poses != after.poses).any(axis=(1, 2))
        person = xp.where(moved, self.person_bits[self.fates.person[rows, tick].astype(np.int32)], zero)
        was_away, away = is_away(before, task), is_away(after, task)
        hidden = ((before.unseen & ~was_away | away) != after.unseen).any(axis=1)
        return person | xp.where(hidden, self.sight_bits[self.fates.sight[rows, tick].astype(np.int32)], zero)

    def of(self, rows: np.ndarray) -> Chances:
        """Return those of some episodes."""
        return dataclasses.replace(self, fates=self.fates[rows])


@dataclasses.dataclass(frozen=True)
class Columns:
    """The columns for a vocabulary."""

    semantics: LeafSemantics

    @functools.cached_property
    def variants(self) -> Variants:
        """Those of the commands."""
        return Variants(self.semantics)

    @functools.cached_property
    def extent(self) -> Extent:
        """Where in the columns what begins."""
        task, ticked = self.semantics.task, self.semantics.num_ticked
        subgoals = len(self.variants.command)
        person = subgoals + ticked
        if task.faults is None:
            return Extent(person, subgoals, ticked, person, person)
        sight = person + num_person_events(task)
        return Extent(sight + num_sight_events(task), subgoals, ticked, person, sight)

    def chances(self, fates: Fates | None, count: int) -> Chances | None:
        """Return what chance has in store for `count` episodes with these fates, None for a task without faults. Where the
        task has faults, nothing goes wrong without fates."""
        task = self.semantics.task
        if task.faults is None:
            return None
        variants = self.variants
        fates = nothing_wrong(task, count) if fates is None else fates
        return Chances(fates, variants.first, variants.classes, variants.bits, person_bits(task), sight_bits(task))

    def released(self, world: World, column: Int32[np.ndarray, " n"]) -> Released:
        """Return the states in the middle of commands, given by their columns."""
        if self.semantics.task.faults is None:
            return act(self.semantics, world, column)
        command = self.variants.command[column]
        return act(
            self.semantics, world, command, self.variants.mishaps(command, column - self.variants.first[command])
        )

    def happened(self, world: World, column: Int32[np.ndarray, " n"]) -> World:
        """Return the states after what is no command: a subgoal that the tree ticks, a person, or what gets out of sight.
        All columns must be of one of these."""
        extent, task = self.extent, self.semantics.task
        if column[0] < extent.person:
            return reach(world, np.int32(1) << (column - extent.subgoals))
        if column[0] < extent.sight:
            return person_acts(world, task, column - extent.person)
        return sight_changes(world, task, column - extent.sight)

    def parts(self, column: Int32[np.ndarray, " n"]) -> list[np.ndarray]:
        """Return the rows of columns that are no commands, those of each sort by themselves."""
        extent = self.extent
        sort = np.digitize(column, [extent.subgoals, extent.person, extent.sight])
        return [rows for one in (1, 2, 3) if (rows := np.flatnonzero(sort == one)).size]


def tick_of(tally: Tally, fates: Fates) -> Int32[Array, " E"]:
    """Return the tick that comes next in each episode, counted from 0, and the last one where it has ended."""
    return namespace(tally.ticks).minimum(tally.ticks, np.int32(fates.person.shape[1] - 1))
