"""What a learnt tree does in many layouts, without dynamics: enough to tell whether two trees do the same."""

from __future__ import annotations

import dataclasses
import math

import jax
import numpy as np
from jaxtyping import Float32, Int32

from bt_jax.behaviors import Behavior, Tree, Vocabulary, expand
from bt_jax.encoding.interpret import TreeMemory, tick_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import leaves
from bt_jax.mjx_env.episodes.rules import NO_COMMAND, Ending, Tally, count_tick, fresh_tally, resolve, select, used_up
from bt_jax.mjx_env.outcomes import command_of, subgoals_of
from bt_jax.mjx_env.physics.kinematic import Kinematic
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import act, reach, settled_world
from bt_jax.mjx_env.world import World, headings, take
from bt_jax.tasks import Task

__all__ = ["Move", "Rehearsal", "first_difference", "parting", "rehearse"]

SPARE = 6  # ticks beyond those that a tree needs where every action succeeds at once
MOST = 10.0  # tolerances; what is further apart is apart


@dataclasses.dataclass(frozen=True, eq=False)
class Move:
    """An object, by its index, that was put down, and the state once it has come to rest (a batch of one)."""

    thing: int
    after: World

    @property
    def pose(self) -> Float32[np.ndarray, "7"]:
        """How it rests: position [m], quaternion wxyz, in the world."""
        return self.after.poses[0, self.thing]


@dataclasses.dataclass(frozen=True, eq=False)
class Rehearsal:
    """One tree in one layout: what it put down, in order, and how it ended, in which state (a batch of one)."""

    moves: tuple[Move, ...]
    ending: Ending
    final: World


def rehearse(tree: Tree, task: Task, layouts: World) -> tuple[Rehearsal, ...]:
    """Run a tree in K layouts (NumPy), all together, at the kinematic level. Nothing goes wrong, and there are ticks
    enough."""
    placements = sum(leaf.name in ("place", "approach") for leaf in leaves(expand(tree)))
    rules = dataclasses.replace(task.episode, max_ticks=SPARE + task.episode.action_ticks * placements)
    task = dataclasses.replace(task, episode=rules, faults=None)
    layouts = dataclasses.replace(layouts, unseen=None)
    semantics, settler = LeafSemantics(task, Vocabulary.of(leaves(tree))), Settler(task, Kinematic(task))
    count, world = len(layouts.held), layouts
    tally, memories = fresh_tally(count, drives=layouts.base is not None), [TreeMemory()] * count
    moves: list[list[Move]] = [[] for _ in range(count)]
    while (tally.ending == Ending.OPEN).any():
        after, tally, memories = _ticked(tree, semantics, settler, world, tally, memories)
        for row in np.flatnonzero((world.held >= 0) & (after.held < 0)):
            moves[row].append(Move(int(world.held[row]), take(after, slice(row, row + 1))))
        world = after
    return tuple(
        Rehearsal(tuple(own), Ending(tally.ending[row]), take(world, slice(row, row + 1)))
        for row, own in enumerate(moves)
    )


@dataclasses.dataclass
class _Row:
    """What the leaves of a tree return in one state, and what they run and reach as they are ticked."""

    vocabulary: Vocabulary
    outcomes: Int32[np.ndarray, "2 V"]
    exhausted: Int32[np.ndarray, "1"]
    commands: dict[int, int] = dataclasses.field(default_factory=dict)  # of the leaves that run, by their index
    subgoals: int = 0  # that count as reached, as bits

    def __call__(self, leaf: Behavior, index: int) -> Status:
        first, second = self.outcomes[:, self.vocabulary.token(leaf), None]
        outcome = resolve(first, second, self.exhausted)
        self.subgoals |= int(subgoals_of(outcome)[0])
        if outcome[0] & 3 == Status.RUNNING:
            self.commands[index] = int(command_of(outcome)[0])
        return Status(outcome[0] & 3)


def _ticked(
    tree: Tree, semantics: LeafSemantics, settler: Settler, world: World, tally: Tally, memories: list[TreeMemory]
) -> tuple[World, Tally, list[TreeMemory]]:
    """Return states, tally and what the nodes remember one tick later; episodes that have ended stay as they are."""
    outcomes, exhausted = semantics.outcomes(world), used_up(tally, semantics.task.episode)
    count = len(world.held)
    status, command, subgoals = (
        np.zeros(count, np.int8),
        np.full(count, NO_COMMAND, np.int32),
        np.zeros(count, np.int32),
    )
    memories = list(memories)
    for row in np.flatnonzero(tally.ending == Ending.OPEN):
        asked = _Row(semantics.vocabulary, outcomes[:, row], exhausted[row : row + 1])
        ticked = tick_tree(tree, asked, memories[row])
        status[row], memories[row], subgoals[row] = ticked.status, ticked.memory, asked.subgoals
        if ticked.running is not None:
            command[row] = asked.commands.get(ticked.running, NO_COMMAND)
    after, broken = reach(world, subgoals), np.zeros(count, bool)
    running = np.flatnonzero(command != NO_COMMAND)
    if running.size:
        released = act(semantics, take(after, running), command[running])
        poses, fine = settler.settle(released)
        broken[running] = ~fine
        settled = settled_world(semantics.task, released, poses)
        after = jax.tree.map(np.array, after)
        for every, new in zip(jax.tree.leaves(after), jax.tree.leaves(settled), strict=True):
            every[running[fine]] = new[fine]
    counted = count_tick(tally, status, command, broken, semantics.task.episode)
    return after, select(tally.ending == Ending.OPEN, counted, tally), memories


def parting(one: Rehearsal, other: Rehearsal, task: Task) -> float:
    """Return how far apart two rehearsals of the same layout are, in the tolerances of the task, at most `MOST`: how far an
    object is put down elsewhere, or turned otherwise. They do the same up to 1."""
    if len(one.moves) != len(other.moves):
        return MOST
    return max((_off(a, b, task) for a, b in zip(one.moves, other.moves, strict=True)), default=0.0)


def first_difference(one: Rehearsal, other: Rehearsal, task: Task) -> int:
    """Return the number of moves that two rehearsals have in common before they part."""
    pairs = zip(one.moves, other.moves, strict=False)
    common = min(len(one.moves), len(other.moves))
    return next((i for i, (a, b) in enumerate(pairs) if _off(a, b, task) > 1), common)


def _off(one: Move, other: Move, task: Task) -> float:
    if one.thing != other.thing:
        return MOST
    off = math.dist(one.pose[:3].tolist(), other.pose[:3].tolist()) / task.episode.tolerance
    period = math.radians(task.objects[one.thing].symmetry)
    turned = float(headings(one.pose[3:]) - headings(other.pose[3:]))
    turn = abs(turned - period * round(turned / period)) if period else 0.0
    return min(max(off, turn / math.radians(task.episode.turn_tolerance)), MOST)
