"""What demonstrations achieve: the goal of each, and which of them share one."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

from bt_jax.behaviors import Behavior
from bt_jax.lfd.conflicts import conflict, undoes
from bt_jax.lfd.demonstration import Demonstrations, Instance
from bt_jax.lfd.inference import Inference

__all__ = ["Carried", "Step", "Subtask", "carried", "goal_of", "sequences", "subtasks"]

Step = int  # index of an inference: what one observed action is an instance of


@dataclasses.dataclass(frozen=True)
class Subtask:
    """Demonstrations (by their index) with the same goal: conditions, in the order in which they come to hold."""

    goal: tuple[Behavior, ...]
    demonstrations: tuple[int, ...]


def sequences(demonstrations: Demonstrations, inferences: Sequence[Inference]) -> list[list[Step]]:
    """Return each demonstration as a sequence of steps."""
    step_at = {instance: step for step, inference in enumerate(inferences) for instance in inference.instances}
    return [
        [step_at[Instance(d, i)] for i in range(len(demonstration.actions))]
        for d, demonstration in enumerate(demonstrations)
    ]


def goal_of(actions: Sequence[Behavior]) -> tuple[Behavior, ...]:
    """Return what holds in the end: the postconditions, from the last action backwards, that conflict with none already kept
    and that no later action undoes; in the order in which they come to hold, those of the gripper last."""
    kept: list[Behavior] = []
    for i, action in reversed(list(enumerate(actions))):
        for condition in action.postconditions:
            gone = any(conflict(condition, other) for other in kept)
            gone = gone or any(undoes(later, condition) for later in actions[i + 1 :])
            if condition not in kept and not gone:
                kept.append(condition)
    return tuple(sorted(reversed(kept), key=lambda condition: condition.name != "at"))


def subtasks(
    inferences: Sequence[Inference], steps: Sequence[Sequence[Step]], things: Sequence[Sequence[str]]
) -> tuple[Subtask, ...]:
    """Return demonstrations grouped by their goals, whatever the order in which these come to hold. `things` are what each
    action of each demonstration handles, an instance where its inference means any of the part."""
    found: dict[frozenset[Behavior], tuple[tuple[Behavior, ...], list[int]]] = {}
    for d, (sequence, own) in enumerate(zip(steps, things, strict=True)):
        done = carried(inferences, sequence, own)
        goal = tuple(dict.fromkeys(done.meaning[condition] for condition in goal_of(done.actions)))
        found.setdefault(frozenset(goal), (goal, []))[1].append(d)
    return tuple(Subtask(goal, tuple(members)) for goal, members in found.values())


@dataclasses.dataclass(frozen=True)
class Carried:
    """The actions of a demonstration on the very objects that it carried, and what each of their postconditions means: the
    same of any instance of a part."""

    actions: tuple[Behavior, ...]
    meaning: Mapping[Behavior, Behavior]


def carried(inferences: Sequence[Inference], sequence: Sequence[Step], things: Sequence[str]) -> Carried:
    """Return the actions of a demonstration, given as steps, on the objects that it carried."""
    actions: list[Behavior] = []
    meaning: dict[Behavior, Behavior] = {}
    for step, thing in zip(sequence, things, strict=True):
        meant = inferences[step].behavior
        actions.append(Behavior(meant.name, (thing, *meant.args[1:])))
        meaning |= dict(zip(actions[-1].postconditions, meant.postconditions, strict=True))
    return Carried(tuple(actions), meaning)
