"""One episode, tick by tick, with everything that there is to show of it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32

from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.episodes.fitness import Ending, fitness, subgoals_missed, target_distances
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import COMMAND_BITS, LeafSemantics
from bt_jax.mjx_env.skills import act, settled_world
from bt_jax.mjx_env.world import World

__all__ = ["Episode", "Playback", "Tick", "play"]


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
        return self.statuses[0]


@dataclasses.dataclass(frozen=True)
class Playback:
    """An episode of one tree in one layout."""

    tree: Tree
    start: World  # a batch of one state
    ticks: tuple[Tick, ...]
    ending: Ending
    distance: Float32[np.ndarray, "targets"]  # metres, at the end
    fitness: float
    solved: bool  # ended in SUCCESS with every target within the tolerance

    @property
    def final(self) -> World:
        """The state at the end, a batch of one."""
        return self.ticks[-1].after


@dataclasses.dataclass(frozen=True)
class Episode:
    """A tree at work in a scene, between two ticks, by the rules of `evaluate.TableEvaluator`. An episode with another
    `world` and otherwise only the first three fields is one that begins there."""

    semantics: LeafSemantics
    settler: Settler
    tree: Tree
    world: World  # a batch of one state (NumPy)
    ending: Ending = Ending.OPEN
    count: int = 0  # ticks so far
    successes: int = 0  # in how many of the last ticks in a row the tree returned SUCCESS
    command: int | None = None  # what ran in the last tick
    runs: int = 0  # in how many of the last ticks in a row it ran

    def tick(self) -> tuple[Tick, Episode]:
        """The next tick, and the episode after it. Raises UserError where a leaf is not in the vocabulary."""
        rules = self.semantics.task.episode
        exhausted = self.command if self.runs >= rules.action_ticks else None
        statuses, command = _tick(self.semantics, self.tree, self.world, exhausted=exhausted)
        after, sane = self.world, True
        if command is not None:
            after, sane = _execute(self.semantics, self.settler, self.world, command)
        status, count = statuses[0], self.count + 1
        successes = self.successes + 1 if status == Status.SUCCESS else 0
        ending = Ending.OPEN
        if not sane:
            ending = Ending.BROKEN
        elif status == Status.FAILURE:
            ending = Ending.FAILURE
        elif successes >= rules.success_ticks:
            ending = Ending.SUCCESS
        elif count >= rules.max_ticks:
            ending = Ending.TIMEOUT
        runs = 0 if command is None else self.runs + 1 if command == self.command else 1
        done = Tick(statuses, None if command is None else self.semantics.commands[command], self.world, after)
        changes = {"world": after, "ending": ending, "count": count, "successes": successes, "runs": runs}
        return done, dataclasses.replace(self, command=command, **changes)


def play(semantics: LeafSemantics, settler: Settler, tree: Tree, layout: World) -> Playback:
    """Runs a tree in a layout, a batch of one state (NumPy), to the end of the episode.

    Raises UserError where a leaf is not in the vocabulary of `semantics`.
    """
    episode, ticks = Episode(semantics, settler, tree, layout), []
    while episode.ending == Ending.OPEN:
        tick, episode = episode.tick()
        ticks.append(tick)
    return _playback(semantics, tree, layout, ticks, episode.ending)


def _tick(
    semantics: LeafSemantics, tree: Tree, world: World, *, exhausted: int | None
) -> tuple[tuple[Status | None, ...], int | None]:
    """Statuses of all nodes, and the command that runs; the command `exhausted` has used up its ticks."""
    outcomes = semantics.outcomes(world)[:, 0]
    running: int | None = None

    def status_of(leaf: Behavior, _: int) -> Status:
        nonlocal running
        token = semantics.vocabulary.token(leaf)
        outcome = int(outcomes[0, token])
        if outcome & 3 == Status.RUNNING and outcome >> COMMAND_BITS == exhausted:
            outcome = int(outcomes[1, token])
        status = Status(outcome & 3)
        if status == Status.RUNNING:
            running = outcome >> COMMAND_BITS
        return status

    return tick_tree(tree, status_of).statuses, running


def _execute(semantics: LeafSemantics, settler: Settler, world: World, command: int) -> tuple[World, bool]:
    """The state once everything rests again; the same state and False where physics gave no number."""
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
    solved = ending == Ending.SUCCESS and bool((distance < task.episode.tolerance).all())
    return Playback(tree, start, tuple(ticks), ending, distance[0], float(value[0]), solved)
