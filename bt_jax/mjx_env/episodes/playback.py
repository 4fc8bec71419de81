"""One episode, tick by tick, with everything needed to show it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32, Int32

from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.fitness import fitness, subgoals_missed, target_distances
from bt_jax.mjx_env.episodes.rules import (
    NO_COMMAND,
    Ending,
    Tally,
    count_tick,
    fresh_tally,
    is_solved,
    resolve,
    used_up,
)
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics, command_of, subgoals_of
from bt_jax.mjx_env.skills import act, reach, settled_world
from bt_jax.mjx_env.world import World

__all__ = ["EpisodeState", "Playback", "Tick", "play"]


@dataclasses.dataclass(frozen=True)
class Tick:
    """One tick and what it did. The worlds are batches of one state (NumPy)."""

    statuses: tuple[Status | None, ...]  # of each node in prefix order, None where it was not ticked
    command: Behavior | None  # the action that ran
    before: World
    after: World

    @property
    def status(self) -> Status:
        """What the tree returned."""
        root = self.statuses[0]
        assert root is not None  # every tick ticks the root
        return root


@dataclasses.dataclass(frozen=True)
class Playback:
    """An episode of one tree in one layout."""

    tree: Tree
    start: World  # a batch of one state
    ticks: tuple[Tick, ...]
    ending: Ending
    distance: Float32[np.ndarray, " targets"]  # metres, at the end
    fitness: float
    solved: bool  # ended in SUCCESS with every target within the tolerance

    @property
    def final(self) -> World:
        """The state at the end, a batch of one."""
        return self.ticks[-1].after


@dataclasses.dataclass(frozen=True)
class EpisodeState:
    """A tree at work in a scene, between two ticks. Without a `tally`, it has not begun."""

    semantics: LeafSemantics
    settler: Settler
    tree: Tree
    world: World  # a batch of one state (NumPy)
    tally: Tally = dataclasses.field(default_factory=lambda: fresh_tally(1))

    @property
    def ending(self) -> Ending:
        """How the episode has ended, OPEN while it goes on."""
        return Ending(self.tally.ending[0])

    def tick(self) -> tuple[Tick, EpisodeState]:
        """Return the next tick, and the episode after it. Raises UserError if a leaf is not in the vocabulary."""
        rules = self.semantics.task.episode
        statuses, command, subgoals = _tick(self.semantics, self.tree, self.world, exhausted=used_up(self.tally, rules))
        after, sane = reach(self.world, subgoals), True
        if command != NO_COMMAND:
            after, sane = _execute(self.semantics, self.settler, after, command)
        tally = count_tick(
            self.tally,
            np.array([statuses[0]], np.int8),
            np.array([command], np.int32),
            np.array([not sane]),
            rules,
        )
        ran = None if command == NO_COMMAND else self.semantics.commands[command]
        return Tick(statuses, ran, self.world, after), dataclasses.replace(self, world=after, tally=tally)


def play(semantics: LeafSemantics, settler: Settler, tree: Tree, layout: World) -> Playback:
    """Run a tree in a layout, a batch of one state (NumPy), to the end of the episode.

    Raises UserError if a leaf is not in the vocabulary of `semantics`.
    """
    episode, ticks = EpisodeState(semantics, settler, tree, layout), []
    while episode.ending == Ending.OPEN:
        tick, episode = episode.tick()
        ticks.append(tick)
    return _playback(semantics, tree, layout, ticks, episode.ending)


def _tick(
    semantics: LeafSemantics, tree: Tree, world: World, *, exhausted: Int32[np.ndarray, "1"]
) -> tuple[tuple[Status | None, ...], int, Int32[np.ndarray, "1"]]:
    """Return the statuses of all nodes, the command that runs or NO_COMMAND, and the subgoals that the tree ticks, as bits;
    the `exhausted` command has failed."""
    outcomes = semantics.outcomes(world)
    running, subgoals = NO_COMMAND, np.zeros(1, np.int32)

    def status_of(leaf: Behavior, _: int) -> Status:
        nonlocal running, subgoals
        token = semantics.vocabulary.token(leaf)
        outcome = resolve(outcomes[0, :, token], outcomes[1, :, token], exhausted)
        status, subgoals = Status(outcome[0] & 3), subgoals | subgoals_of(outcome)
        if status == Status.RUNNING:
            running = int(command_of(outcome)[0])
        return status

    return tick_tree(tree, status_of).statuses, running, subgoals


def _execute(semantics: LeafSemantics, settler: Settler, world: World, command: int) -> tuple[World, bool]:
    """Return the state once everything rests again; the same state and False where the simulation diverged."""
    released = act(semantics, world, np.array([command], np.int32))
    poses, ok = settler.settle(released)
    if not ok[0]:
        return world, False
    return settled_world(semantics.task, released, poses), True


def _playback(semantics: LeafSemantics, tree: Tree, start: World, ticks: list[Tick], ending: Ending) -> Playback:
    task, final = semantics.task, ticks[-1].after
    distance = target_distances(task, final)
    value = fitness(
        task,
        distance=distance.sum(axis=-1),
        subgoals_missed=subgoals_missed(final),
        nodes=np.array([len(prefix(tree))], np.int32),
        ending=np.array([ending], np.int8),
    )
    solved = bool(is_solved(np.array([ending], np.int8), distance, task.episode)[0])
    return Playback(tree, start, tuple(ticks), ending, distance[0], float(value[0]), solved)
