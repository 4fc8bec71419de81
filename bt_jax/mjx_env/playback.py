"""One episode, tick by tick, with everything that there is to show of it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float32

from bt_jax.behaviors import Behavior, Tree
from bt_jax.encoding.interpret import tick_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.fitness import Ending, fitness, subgoals_missed, target_distances
from bt_jax.mjx_env.settling import Settler
from bt_jax.mjx_env.skills import act, settled_world
from bt_jax.mjx_env.statuses import COMMAND_BITS, Semantics
from bt_jax.mjx_env.world import World

__all__ = ["Playback", "Tick", "play"]


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


def play(semantics: Semantics, settler: Settler, tree: Tree, layout: World) -> Playback:
    """Runs a tree in a layout, a batch of one state (NumPy), by the rules of `evaluate.TableEvaluator`.

    Raises UserError where a leaf is not in the vocabulary of `semantics`.
    """
    rules = semantics.task.episode
    world, ticks, ending = layout, [], Ending.OPEN
    successes, last, runs = 0, None, 0
    while ending == Ending.OPEN:
        ticked, command = _tick(semantics, tree, world, exhausted=last if runs >= rules.action_ticks else None)
        after, sane = world, True
        if command is not None:
            after, sane = _execute(semantics, settler, world, command)
        ticks.append(Tick(ticked, None if command is None else semantics.commands[command], world, after))
        status = ticked[0]
        successes = successes + 1 if status == Status.SUCCESS else 0
        runs = 0 if command is None else runs + 1 if command == last else 1
        world, last = after, command
        if not sane:
            ending = Ending.BROKEN
        elif status == Status.FAILURE:
            ending = Ending.FAILURE
        elif successes >= rules.success_ticks:
            ending = Ending.SUCCESS
        elif len(ticks) >= rules.max_ticks:
            ending = Ending.TIMEOUT
    return _playback(semantics, tree, layout, ticks, ending)


def _tick(
    semantics: Semantics, tree: Tree, world: World, *, exhausted: int | None
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


def _execute(semantics: Semantics, settler: Settler, world: World, command: int) -> tuple[World, bool]:
    """The state once everything rests again; the same state and False where physics gave no number."""
    released = act(semantics, world, np.array([command], np.int32))
    poses, ok = settler.settle(released)
    if not ok[0]:
        return world, False
    return settled_world(semantics.task, released, poses), True


def _playback(semantics: Semantics, tree: Tree, start: World, ticks: list[Tick], ending: Ending) -> Playback:
    task, final = semantics.task, ticks[-1].after
    distance = target_distances(task, final)
    value = fitness(
        task,
        distance=distance.sum(axis=-1),
        missed=subgoals_missed(final),
        nodes=np.array([len(prefix(tree))], np.int32),
        ending=np.array([ending], np.int8),
    )
    solved = ending == Ending.SUCCESS and bool((distance < task.episode.tolerance).all())
    return Playback(tree, start, tuple(ticks), ending, distance[0], float(value[0]), solved)
