"""What chance has in store for episodes, drawn from keys alone: the run, the layout, the draw and the tick.

A fate is the same whichever tree meets it, so that selection compares like with like, and an episode can be repeated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int8, Int16, Int32

from bt_jax.mjx_env.faults.events import ALL_SEEN, SPOTS, brings, hides, moves, person_acts, sight_changes, takes
from bt_jax.mjx_env.faults.variants import FRACTIONS, JAMS, SLIPS, Variants, affected, num_errors
from bt_jax.mjx_env.scene.layouts import sample_layouts
from bt_jax.mjx_env.skills import Released, act
from bt_jax.mjx_env.world import Array, World, namespace, take
from bt_jax.tasks import Faults, Task

__all__ = [
    "Fates",
    "between_ticks",
    "carry_out",
    "drawn",
    "joined",
    "nothing_wrong",
    "sample_episodes",
    "sample_fates",
    "something_happens",
]

FATES = 1 << 22  # what keeps their keys apart from those of layouts


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Fates:
    """The fates of E episodes of at most T ticks. C are the classes of commands (see `Variants.classes`), K is
    `len(Task.kinds)`."""

    variant: Int8[Array, "E T C"]  # how a command of each class goes, were it to run in that tick
    person: Int16[Array, "E T"]  # what a person does after the tick (see `events`)
    sight: Int8[Array, "E T"]  # what gets out of sight, or into sight, after it
    heavy: Bool[Array, "E K"]  # what is heavier or more slippery than thought
    unit: Float32[Array, "E T K 3"] | None = None  # errors of places, in spreads; None for the quasi-random ones

    def __getitem__(self, rows: Array | slice | int) -> Fates:
        """Return the fates of some episodes."""
        return jax.tree.map(lambda leaf: leaf[rows], self)

    def variant_of(self, tick: Int32[Array, " E"], of_class: Int32[Array, " E"]) -> Int32[Array, " E"]:
        """Return how a command of a class goes that each episode runs in its tick: with class -1 nothing goes wrong."""
        xp = namespace(tick)
        found = self.variant[np.arange(tick.shape[0]), tick, xp.maximum(of_class, 0)].astype(np.int32)
        return xp.where(of_class < 0, np.int32(0), found)


def sample_fates(
    task: Task, seed: int | list[int], *, layouts: int | range, draws: int | range, continuous: bool = False
) -> Fates | None:
    """Return the fates (NumPy) of several draws, given by their number or a range, in each of several layouts of
    `sample_layouts(task, seed, ...)`, those of one layout side by side; None for a task without faults. With `continuous`,
    errors of places are Gaussian instead of one of NUM_ERRORS."""
    faults = task.faults
    if faults is None:
        return None
    keys = [FATES, *np.atleast_1d(seed).tolist()]
    each, every = (of if isinstance(of, range) else range(of) for of in (layouts, draws))
    streams = [np.random.default_rng([*keys, layout, draw]) for layout in each for draw in every]
    ticks, kinds = task.episode.max_ticks, len(task.kinds)
    chosen = affected(task)
    heavy = np.array([rng.random(kinds) for rng in streams]) < faults.heavy * chosen
    # One row of numbers for each tick, so that a longer episode begins as a shorter one.
    numbers = np.array([rng.random((ticks, 7 + 3 * kinds)) for rng in streams])
    grip, picks, places, which, rest = np.split(numbers, np.cumsum([2, kinds, kinds, kinds]), axis=2)
    classes = [
        grip < faults.jam,
        _picks(faults, picks, heavy, chosen),
        _places(faults, places, which, heavy, chosen),
    ]
    sight, sighted, person, concerned, spot = np.moveaxis(rest, 2, 0)
    objects = np.array([(thing.part or thing.name) in np.array(task.kinds)[chosen] for thing in task.objects])
    units = None
    if continuous:
        units = np.array([rng.standard_normal((ticks, kinds, 3)) for rng in streams], np.float32)
    return Fates(
        np.concatenate(classes, axis=2).astype(np.int8),
        _persons(task, faults, person, _one_of(objects, concerned), (spot * SPOTS).astype(int)),
        _sights(faults, sight, _one_of(objects, sighted)),
        heavy,
        units,
    )


def sample_episodes(task: Task, seed: int | list[int], *, layouts: int, draws: int) -> tuple[World, Fates | None]:
    """Return where episodes start and their fates (NumPy), one row each: `draws` of them in each of the layouts, or one
    where nothing goes wrong, those of one layout side by side."""
    starts, fates = sample_layouts(task, seed, layouts), sample_fates(task, seed, layouts=layouts, draws=draws)
    return (starts, None) if fates is None else (take(starts, np.repeat(np.arange(layouts), draws)), fates)


def nothing_wrong(task: Task, count: int) -> Fates:
    """Return fates (NumPy) of episodes in which nothing goes wrong."""
    ticks, kinds = task.episode.max_ticks, len(task.kinds)
    return Fates(
        np.zeros((count, ticks, 2 + 2 * kinds), np.int8),
        np.zeros((count, ticks), np.int16),
        np.zeros((count, ticks), np.int8),
        np.zeros((count, kinds), bool),
    )


def joined(fates: Sequence[Fates]) -> Fates:
    """Join fates (NumPy)."""
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *fates)


def drawn(
    fates: Fates, variants: Variants, tick: Int32[Array, " E"], command: Int32[Array, " E"]
) -> tuple[Int32[Array, " E"], Float32[Array, "E 3"] | None]:
    """Return how the command goes that each episode runs in its tick, counted from 0: its variant, and where fates are
    continuous the error in spreads, for `Variants.mishaps`."""
    xp, rows = namespace(tick), np.arange(tick.shape[0])
    of_class = xp.asarray(variants.classes)[command]
    variant = fates.variant_of(tick, of_class)
    if fates.unit is None:
        return variant, None
    return variant, fates.unit[rows, tick, xp.maximum(of_class - 2 - fates.unit.shape[2], 0)]


def carry_out(
    variants: Variants, world: World, command: Int32[Array, " E"], fates: Fates | None, tick: Int32[Array, " E"]
) -> Released:
    """Carry out the command that each episode runs in its tick, counted from 0, as its fate wants it."""
    if fates is None:
        return act(variants.semantics, world, command)
    variant, unit = drawn(fates, variants, tick, command)
    return act(variants.semantics, world, command, variants.mishaps(command, variant, unit))


def something_happens(fates: Fates, tick: Int32[Array, " E"]) -> Bool[Array, " E"]:
    """Return in which episodes `between_ticks` may change anything."""
    rows = np.arange(tick.shape[0])
    return (fates.person[rows, tick] > 0) | (fates.sight[rows, tick] > 0)


def between_ticks(world: World, task: Task, fates: Fates, tick: Int32[Array, " E"]) -> World:
    """Return the states of E episodes after what happens behind a tick, counted from 0, whatever the robot does."""
    rows = np.arange(tick.shape[0])
    world = person_acts(world, task, fates.person[rows, tick].astype(np.int32))
    return sight_changes(world, task, fates.sight[rows, tick].astype(np.int32))


def _one_of(objects: Bool[np.ndarray, " B"], number: Float64[np.ndarray, "E T"]) -> np.ndarray:
    """Return which of the chosen objects a number in 0..1 means, int[E, T]."""
    chosen = np.flatnonzero(objects)
    return chosen[(number * len(chosen)).astype(int)]


def _picks(faults: Faults, number: np.ndarray, heavy: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return how picks go, int[E, T, K]."""
    slips = np.maximum(faults.slip * chosen, faults.heavy_slip * heavy)[:, None]
    return np.where(number < faults.jam, JAMS, np.where(number < faults.jam + slips, SLIPS, 0))


def _places(faults: Faults, number: np.ndarray, which: np.ndarray, heavy: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return how places go, int[E, T, K]."""
    drops = np.maximum(faults.drop * chosen, faults.heavy_slip * heavy)[:, None]
    errors = num_errors(faults)
    falls = errors + 2 + (which * len(FRACTIONS)).astype(int)
    strays = np.where(chosen, min(errors, 1) + (which * errors).astype(int), 0)
    return np.where(number < faults.jam, errors + 1, np.where(number < faults.jam + drops, falls, strays))


def _sights(faults: Faults, number: np.ndarray, thing: np.ndarray) -> Int8[np.ndarray, "E T"]:
    """Return when one object at a time gets out of sight, and into sight again."""
    events, left = np.zeros(number.shape, np.int8), np.zeros(len(number), int)
    for tick in range(number.shape[1]):
        hidden = left > 0
        left = left - hidden
        goes = ~hidden & (number[:, tick] < faults.hide)
        events[:, tick] = np.where(goes, hides(thing[:, tick]), np.where(hidden & (left == 0), ALL_SEEN, 0))
        left = np.where(goes, faults.hide_ticks, left)
    return events


def _persons(
    task: Task, faults: Faults, number: np.ndarray, thing: np.ndarray, spot: np.ndarray
) -> Int16[np.ndarray, "E T"]:
    """Return what a person does after each tick: nothing else while an object is taken away, until it is brought back."""
    events, left = np.zeros(number.shape, np.int16), np.zeros(len(number), int)
    taken = np.zeros(len(number), int)
    for tick in range(number.shape[1]):
        away, one, there = left > 0, thing[:, tick], spot[:, tick]
        left = left - away
        takes_one = ~away & (number[:, tick] < faults.take)
        moves_one = ~away & ~takes_one & (number[:, tick] < faults.take + faults.move)
        events[:, tick] = np.select(
            [takes_one, moves_one, away & (left == 0)],
            [takes(task, one), moves(task, one, there), brings(task, taken, there)],
        )
        taken = np.where(takes_one, one, taken)
        left = np.where(takes_one, faults.take_ticks, left)
    return events
