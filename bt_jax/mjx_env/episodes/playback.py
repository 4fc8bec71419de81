"""One episode, tick by tick, with everything needed to show it."""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Int32

from bt_jax.behaviors import Behavior, Tree, not_reactive
from bt_jax.encoding.interpret import TreeMemory, TreeTick, tick_tree
from bt_jax.encoding.tick import Status
from bt_jax.encoding.walk import prefix
from bt_jax.mjx_env.driving import driven
from bt_jax.mjx_env.episodes.columns import Columns
from bt_jax.mjx_env.episodes.fitness import Misses, fitness, subgoals_missed, target_misses
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
from bt_jax.mjx_env.faults.fates import Fates, between_ticks, drawn
from bt_jax.mjx_env.faults.words import between_words, command_words
from bt_jax.mjx_env.outcomes import command_of, subgoals_of
from bt_jax.mjx_env.physics.settler import Settler
from bt_jax.mjx_env.semantics import LeafSemantics
from bt_jax.mjx_env.skills import Mishaps, act, reach, settled_world
from bt_jax.mjx_env.world import World

__all__ = ["SECONDS_PER_TICK", "EpisodeState", "Playback", "Tick", "play"]

SECONDS_PER_TICK = 2.5  # on the clock of Timeouts, as in the published simulation


@dataclasses.dataclass(frozen=True)
class Tick:
    """One tick and what it did. The worlds are batches of one state (NumPy). Where things go wrong, the next tick may begin
    in another state than that in which this one has ended."""

    statuses: tuple[Status | None, ...]  # of each node in prefix order, None where it was not ticked
    command: Behavior | None  # the action that ran
    before: World
    after: World
    mishaps: Mishaps | None = None  # of the action, a batch of one
    troubles: tuple[str, ...] = ()  # what went wrong, in its course and between it and the next tick, for people

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
    misses: Misses  # [targets], at the end
    fitness: float
    solved: bool  # ended in SUCCESS with every target within the tolerance
    struck: int = 0  # faults that happened, as bits (see `faults.variants.bit`)
    travel: float = 0.0  # metres that the base has driven

    @property
    def final(self) -> World:
        """The state at the end, a batch of one."""
        return self.ticks[-1].after


@dataclasses.dataclass(frozen=True)
class EpisodeState:
    """A tree at work in a scene, between two ticks. Without a `tally`, it has not begun. Without a `fate`, a batch of one,
    nothing goes wrong."""

    semantics: LeafSemantics
    settler: Settler
    tree: Tree
    world: World  # a batch of one state (NumPy)
    tally: Tally = dataclasses.field(default_factory=lambda: fresh_tally(1))
    memory: TreeMemory = dataclasses.field(default_factory=TreeMemory)
    fate: Fates | None = None

    @property
    def ending(self) -> Ending:
        """How the episode has ended, OPEN while it goes on."""
        return Ending(self.tally.ending[0])

    def tick(self) -> tuple[Tick, EpisodeState]:
        """Return the next tick, and the episode after it. Raises UserError if a leaf is not in the vocabulary."""
        rules = self.semantics.task.episode
        reactive = not_reactive(self.tree) is None
        if not reactive:  # ticked again after its SUCCESS, it would begin from the start
            rules = dataclasses.replace(rules, success_ticks=1)
        ticked, command, subgoals, again = self._ticked(exhausted=used_up(self.tally, rules), fails_once=not reactive)
        after, sane, number = reach(self.world, subgoals), True, np.array([command], np.int32)
        mishaps, struck, troubles = None, np.zeros(1, np.int32), []
        if command != NO_COMMAND:
            if self.fate is not None:
                mishaps, struck = self._mishaps(self.fate, number)
                troubles.append(command_words(self.semantics.task, after, self.semantics.commands[command], mishaps))
            after, sane = _execute(self.semantics, self.settler, after, number, mishaps)
        before = dataclasses.replace(self.tally, command=np.array([NO_COMMAND], np.int32)) if again else self.tally
        status, broken = np.array([ticked.status], np.int8), np.array([not sane])
        travel = driven(self.world.base, after.base)
        tally = count_tick(before, status, number, broken, rules, struck=struck, travel=travel)
        world = after
        if self.fate is not None and tally.ending[0] == Ending.OPEN:
            world = between_ticks(after, self.semantics.task, self.fate, self.tally.ticks)
            troubles += between_words(self.semantics.task, after, world)
            tally = self._counted(self.fate, tally, after, world)
        ran = None if command == NO_COMMAND else self.semantics.commands[command]
        following = dataclasses.replace(self, world=world, tally=tally, memory=ticked.memory)
        return Tick(ticked.statuses, ran, self.world, after, mishaps, tuple(filter(None, troubles))), following

    def _mishaps(self, fate: Fates, command: Int32[np.ndarray, "1"]) -> tuple[Mishaps, Int32[np.ndarray, "1"]]:
        """Return what goes wrong with a command in this tick, and the faults that this is, as bits."""
        columns, tick = Columns(self.semantics), self.tally.ticks
        chances = columns.chances(fate, 1)
        assert chances is not None
        variant, unit = drawn(fate, columns.variants, tick, command)
        struck = chances.struck(chances.column(command, tick), command)
        return columns.variants.mishaps(command, variant, unit), struck

    def _counted(self, fate: Fates, tally: Tally, before: World, after: World) -> Tally:
        """Return the tally with the faults that happened between this tick and the next."""
        chances = Columns(self.semantics).chances(fate, 1)
        assert chances is not None
        assert tally.struck is not None
        found = chances.struck_between(self.semantics.task, before, after, self.tally.ticks)
        return dataclasses.replace(tally, struck=tally.struck | found)

    def _ticked(
        self, *, exhausted: Int32[np.ndarray, "1"], fails_once: bool
    ) -> tuple[TreeTick, int, Int32[np.ndarray, "1"], bool]:
        """Return the tick of the tree, the command that runs or NO_COMMAND, the subgoals that the tree ticks, as bits, and
        whether the `exhausted` command, which has failed, has begun again: where it `fails_once`, a loop tries it again."""
        outcomes = self.semantics.outcomes(self.world)
        commands: dict[int, int] = {}  # of the leaves that run, by their index
        subgoals, again = np.zeros(1, np.int32), False

        def status_of(leaf: Behavior, index: int) -> Status:
            nonlocal subgoals, again
            token = self.semantics.vocabulary.token(leaf)
            spent = np.array([NO_COMMAND], np.int32) if again else exhausted
            outcome = resolve(outcomes[0, :, token], outcomes[1, :, token], spent)
            again = again or (fails_once and bool(outcome[0] != outcomes[0, 0, token]))
            status, subgoals = Status(outcome[0] & 3), subgoals | subgoals_of(outcome)
            if status == Status.RUNNING:
                commands[index] = int(command_of(outcome)[0])
            return status

        time = SECONDS_PER_TICK * int(self.tally.ticks[0])
        ticked = tick_tree(self.tree, status_of, self.memory, time=time)
        running = NO_COMMAND if ticked.running is None else commands.get(ticked.running, NO_COMMAND)
        return ticked, running, subgoals, again


def play(semantics: LeafSemantics, settler: Settler, tree: Tree, layout: World, fate: Fates | None = None) -> Playback:
    """Run a tree in a layout, a batch of one state (NumPy), to the end of the episode, with a fate, a batch of one, if
    things go wrong.

    Raises UserError if a leaf is not in the vocabulary of `semantics`.
    """
    tally = fresh_tally(1, has_faults=fate is not None, drives=layout.base is not None)
    episode, ticks = EpisodeState(semantics, settler, tree, layout, tally, fate=fate), []
    while episode.ending == Ending.OPEN:
        tick, episode = episode.tick()
        ticks.append(tick)
    playback = _playback(semantics, tree, layout, ticks, episode.tally)
    return (
        playback if episode.tally.struck is None else dataclasses.replace(playback, struck=int(episode.tally.struck[0]))
    )


def _execute(
    semantics: LeafSemantics,
    settler: Settler,
    world: World,
    command: Int32[np.ndarray, "1"],
    mishaps: Mishaps | None,
) -> tuple[World, bool]:
    """Return the state once everything rests again; the same state and False where the simulation diverged."""
    released = act(semantics, world, command, mishaps)
    poses, ok = settler.settle(released)
    if not ok[0]:
        return world, False
    return settled_world(semantics.task, released, poses), True


def _playback(semantics: LeafSemantics, tree: Tree, start: World, ticks: list[Tick], tally: Tally) -> Playback:
    task, final, ending = semantics.task, ticks[-1].after, Ending(tally.ending[0])
    misses = target_misses(task, final)
    value = fitness(
        task,
        distance=misses.distance.sum(axis=-1),
        turn=misses.turn.sum(axis=-1),
        subgoals_missed=subgoals_missed(final),
        nodes=np.array([len(prefix(tree))], np.int32),
        ending=np.array([ending], np.int8),
        travel=tally.travel,
    )
    solved = bool(is_solved(np.array([ending], np.int8), misses.met)[0])
    own = Misses(misses.distance[0], misses.turn[0], misses.met[0])
    travel = 0.0 if tally.travel is None else float(tally.travel[0])
    return Playback(tree, start, tuple(ticks), ending, own, float(value[0]), solved, travel=travel)
