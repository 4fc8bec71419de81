"""What follows from one tick: a function of what is known and nothing else, so that a log can be replayed."""

from __future__ import annotations

import dataclasses
import enum

from bt_jax.behaviors import Behavior, Tree
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.program import Program
from bt_jax.deploy.execution.settings import SIMULATED_TICK
from bt_jax.deploy.execution.statuses import Context, Statuses
from bt_jax.encoding.interpret import TreeMemory, TreeTick, tick_tree
from bt_jax.encoding.walk import prefix

__all__ = ["Decision", "Look", "Step", "decide"]


class Step(enum.StrEnum):
    """What is to be done after a tick."""

    ACTING = "acting"  # go on with the attempt
    UNSEEN = "acting unseen"  # go on with it: what speaks against it is not known
    HALTING = "halting"  # break off the attempt, or the look
    LOOKING = "looking"  # do nothing before what is asked for is seen
    STARTING = "starting"  # begin what the tree wants
    WAITING = "waiting"  # the tree wants nothing


@dataclasses.dataclass(frozen=True)
class Look:
    """How far a look at the cell has come."""

    looking: bool = False  # the arms are on their way out of the camera's view
    looked: float | None = None  # when they were out of it last [s]; None: not since the last new doubt
    undecided: frozenset[Behavior] = frozenset()  # conditions that could not be decided at the last tick

    def after(self, undecided: frozenset[Behavior]) -> Look:
        """Return what it is after a tick: a new doubt needs a new look."""
        settled = undecided == self.undecided or undecided < self.undecided
        return Look(self.looking, self.looked if settled else None, undecided)

    def blind(self, now: float, patience: float) -> bool:
        """May what is undecided still be seen, up to `patience` seconds after a look?"""
        return bool(self.undecided) and (self.looked is None or now - self.looked < patience)


@dataclasses.dataclass(frozen=True)
class Decision:
    """One tick of a tree, the look after it, the action that the tree wants, the next step, the subgoals that count as
    reached from now on, and what the nodes remember. A tick that is not acted upon, since something is not seen, is not
    remembered."""

    ticked: TreeTick
    look: Look
    wanted: Behavior | None
    step: Step
    reached: frozenset[str]
    memory: TreeMemory


def decide(
    program: Program,
    tree: Tree,
    seen: Observation,
    context: Context,
    look: Look,
    memory: TreeMemory,
    *,
    now: float,
    patience: float,
    tick: float,
) -> Decision:
    """Tick an expanded tree and say what follows. `memory` is that of the decision before; `patience` [s]: how long after a
    look what is not seen may yet be seen; `tick` [s]: how much time passes from tick to tick."""
    statuses = Statuses(program.task, seen, context)
    ticked = tick_tree(tree, statuses, memory, time=now, ticks=tick / SIMULATED_TICK)
    look = look.after(frozenset(statuses.undecided))
    node = None if ticked.running is None else prefix(tree)[ticked.running]
    wanted = node if isinstance(node, Behavior) else None
    step = _step(context.attempt, wanted, look, blind=look.blind(now, patience))
    kept = memory if step in (Step.LOOKING, Step.UNSEEN) else ticked.memory
    return Decision(ticked, look, wanted, step, frozenset(statuses.ticked), kept)


def _step(attempt: Behavior | None, wanted: Behavior | None, look: Look, *, blind: bool) -> Step:
    if attempt is not None:
        if wanted == attempt:
            return Step.ACTING
        return Step.UNSEEN if blind else Step.HALTING
    if blind:
        return Step.LOOKING
    if wanted is None:
        return Step.WAITING
    return Step.HALTING if look.looking else Step.STARTING
