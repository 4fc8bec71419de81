"""The rules of an episode, once for everything that runs one: when it ends, when an action has used up its ticks, and what
counts as solved. Functions take NumPy or JAX arrays and return the same kind.

An episode ends in FAILURE as soon as the root fails, in SUCCESS once the root has succeeded in a number of ticks in a row,
in TIMEOUT after its last tick, and as BROKEN where the simulation diverged.
"""

from __future__ import annotations

import dataclasses
import enum

import jax
import numpy as np
from jaxtyping import Bool, Float32, Int8, Int32, UInt8

from bt_jax.encoding.tick import Status
from bt_jax.mjx_env.outcomes import command_of
from bt_jax.mjx_env.world import Array, namespace
from bt_jax.tasks import Episode

__all__ = ["NO_COMMAND", "Ending", "Tally", "count_tick", "fresh_tally", "is_solved", "resolve", "select", "used_up"]

NO_COMMAND = -1


class Ending(enum.IntEnum):
    """How an episode ended. BROKEN: the simulation diverged."""

    OPEN = 0
    SUCCESS = 1
    FAILURE = 2
    TIMEOUT = 3
    BROKEN = 4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Tally:
    """What the rules remember of E episodes between two ticks."""

    ticks: Int32[Array, " E"]
    successes: Int32[Array, " E"]  # ticks in a row, up to the last one, that returned SUCCESS
    command: Int32[Array, " E"]  # that ran in the last tick, or NO_COMMAND
    runs: Int32[Array, " E"]  # ticks in a row, up to the last one, in which it ran
    ending: Int8[Array, " E"]
    trace: UInt8[Array, "E N"] | None = None  # where asked for, of all ticks so far (see `encoding.tick.Ticked`)
    counts: UInt8[Array, "E N"] | None = None  # of decorators, if trees may have any (see `encoding.tick.Ticked`)
    struck: Int32[Array, " E"] | None = None  # faults that happened, as bits (see `faults.variants.bit`)
    travel: Float32[Array, " E"] | None = None  # metres that the base has driven


def fresh_tally(
    count: int,
    *,
    num_nodes: int = 0,
    trace: bool = False,
    counting: bool = False,
    has_faults: bool = False,
    drives: bool = False,
) -> Tally:
    """Return the tally of episodes that have not begun (NumPy), of trees with so many nodes: with a trace if asked for, and
    `counting` where trees may have decorators."""
    zeros, nodes = np.zeros(count, np.int32), np.zeros((count, num_nodes), np.uint8)
    return Tally(
        ticks=zeros,
        successes=zeros,
        command=zeros + np.int32(NO_COMMAND),
        runs=zeros,
        ending=np.zeros(count, np.int8),
        trace=nodes if trace else None,
        counts=nodes if counting else None,
        struck=zeros if has_faults else None,
        travel=np.zeros(count, np.float32) if drives else None,
    )


def used_up(tally: Tally, rules: Episode) -> Int32[Array, " E"]:
    """Return the command that fails from now on since it ran for all the ticks an action has, or NO_COMMAND."""
    return namespace(tally.runs).where(tally.runs >= rules.action_ticks, tally.command, np.int32(NO_COMMAND))


def resolve(
    outcome: Int32[Array, " E"], second: Int32[Array, " E"], exhausted: Int32[Array, " E"]
) -> Int32[Array, " E"]:
    """Return which of the two outcomes of a leaf counts (see `LeafSemantics.outcomes`): the second where the first one runs
    the `exhausted` command."""
    spent = (outcome & 3 == Status.RUNNING) & (command_of(outcome) == exhausted)
    return namespace(outcome).where(spent, second, outcome)


def count_tick(
    tally: Tally,
    status: Int8[Array, " E"],
    command: Int32[Array, " E"],
    broken: Bool[Array, " E"],
    rules: Episode,
    trace: UInt8[Array, "E N"] | None = None,
    counts: UInt8[Array, "E N"] | None = None,
    struck: Int32[Array, " E"] | None = None,
    travel: Float32[Array, " E"] | None = None,
) -> Tally:
    """Return the tally after one tick in which the root returned `status`; `command` counts where that is RUNNING, unless it
    is NO_COMMAND, and the simulation of it diverged where `broken`. `trace`, `counts`, the faults that `struck` and the
    metres of `travel` are those of the tick. Episodes that have ended stay as they are."""
    xp = namespace(tally.ticks)
    zero, one = np.int32(0), np.int32(1)
    running = status == Status.RUNNING
    acts = running & (command != NO_COMMAND)
    ticks = tally.ticks + one
    successes = xp.where(status == Status.SUCCESS, tally.successes + one, zero)
    again = running & (command == tally.command)
    runs = xp.where(running, xp.where(again, tally.runs + one, one), zero)
    ending = xp.where(ticks >= rules.max_ticks, np.int8(Ending.TIMEOUT), np.int8(Ending.OPEN))
    ending = xp.where(successes >= rules.success_ticks, np.int8(Ending.SUCCESS), ending)
    ending = xp.where(status == Status.FAILURE, np.int8(Ending.FAILURE), ending)
    ending = xp.where(acts & broken, np.int8(Ending.BROKEN), ending)
    traced = None if tally.trace is None or trace is None else tally.trace | trace
    faults = tally.struck if tally.struck is None or struck is None else tally.struck | xp.where(acts, struck, zero)
    ran = xp.where(running, command, np.int32(NO_COMMAND))
    driven = None if tally.travel is None else tally.travel + travel
    new = Tally(ticks, successes, ran, runs, ending, traced, counts, faults, driven)
    return select(tally.ending == Ending.OPEN, new, tally)


def select(condition: Bool[Array, " E"], yes: Tally, no: Tally) -> Tally:
    """Return one tally where a condition holds, and the other elsewhere."""
    where = namespace(condition).where
    return jax.tree.map(lambda a, b: where(condition.reshape(-1, *[1] * (a.ndim - 1)), a, b), yes, no)


def is_solved(ending: Int8[Array, "*E"], met: Bool[Array, "*E targets"]) -> Bool[Array, "*E"]:
    """Return which episodes ended in SUCCESS with every target met."""
    return (ending == Ending.SUCCESS) & met.all(axis=-1)
