"""In which order things must happen, as far as all demonstrations agree on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior
from bt_jax.lfd.conflicts import conflict, implies, undoes
from bt_jax.lfd.corrections import Instance
from bt_jax.lfd.goals import Step, carried
from bt_jax.lfd.inference import Inference

__all__ = ["Order", "check_acyclic", "meant", "orders", "preconditions"]


@dataclasses.dataclass(frozen=True)
class Order:
    """`before` precedes `after` in all `seen` demonstrations that have both; `distance` is how many steps apart they are
    at least."""

    before: Step
    after: Step
    seen: int
    distance: int


def orders(steps: Sequence[Sequence[Step]]) -> tuple[Order, ...]:
    """Return all pairs in a constant order; one reversed observation, also within a demonstration, cancels a pair for
    good."""
    found: dict[tuple[Step, Step], list[int]] = {}
    for sequence in steps:
        for j, after in enumerate(sequence):
            for i in range(j):
                found.setdefault((sequence[i], after), []).append(j - i)
    return tuple(
        Order(before, after, len(distances), min(distances))
        for (before, after), distances in sorted(found.items())
        if (after, before) not in found and before != after
    )


def meant(
    constraints: Sequence[Order],
    steps: Sequence[Sequence[Step]],
    said: Mapping[tuple[Instance, Instance], bool],
) -> tuple[Order, ...]:
    """Return the orders without those of which a person has said that they are not meant: of two placements, with the picks
    before them."""
    free: set[tuple[Step, Step]] = set()
    for (before, after), is_meant in said.items():
        sequence = steps[before.demonstration]
        if not is_meant:
            own, later = (sequence[max(one.index - 1, 0) : one.index + 1] for one in (before, after))
            free |= {(a, b) for a in own for b in later}
    return tuple(order for order in constraints if (order.before, order.after) not in free)


def check_acyclic(constraints: Sequence[Order], inferences: Sequence[Inference]) -> None:
    """Raise UserError, naming the actions, if the constraints of different demonstrations go in a circle."""
    later: dict[Step, list[Step]] = {}
    for order in constraints:
        later.setdefault(order.before, []).append(order.after)
    done: set[Step] = set()

    def visit(step: Step, path: tuple[Step, ...]) -> None:
        if step in path:
            circle = [str(inferences[i].behavior) for i in (*path[path.index(step) :], step)]
            raise UserError(
                f"the demonstrations contradict each other in the order of {' before '.join(circle)}; delete or repeat one"
            )
        if step not in done:
            for other in later.get(step, ()):
                visit(other, (*path, step))
            done.add(step)

    for step in later:
        visit(step, ())


def preconditions(
    constraints: Sequence[Order],
    inferences: Sequence[Inference],
    steps: Sequence[Sequence[Step]],
    things: Sequence[Sequence[str]],
    *,
    parts: Collection[str] = (),
) -> Mapping[Behavior, tuple[Behavior, ...]]:
    """Return for each action of the demonstrations the conditions beyond its own preconditions that earlier actions
    establish and that still hold when it begins: their postconditions, the nearest action's where they conflict, none that
    conflicts with what the action itself needs, and none that it undoes: that would contradict its own postconditions. Of an
    action that is done several times, those that hold each time. `things` are what each action handles, `parts` the names
    that stand for several of them."""
    moments = [
        dict(zip(sequence, _held(sequence, inferences, own), strict=True))
        for sequence, own in zip(steps, things, strict=True)
    ]
    extra: dict[Behavior, tuple[Behavior, ...]] = {}
    for step in sorted(set().union(*moments)):
        action = inferences[step].behavior
        kept = list(action.preconditions)
        for order in sorted((o for o in constraints if o.after == step), key=lambda o: (o.distance, o.before)):
            both = [held[step] for held in moments if order.before in held and step in held]
            for condition in inferences[order.before].behavior.postconditions:
                known = any(implies(other, condition) or conflict(condition, other, parts=parts) for other in kept)
                if not known and not undoes(action, condition, parts=parts) and all(condition in held for held in both):
                    kept.append(condition)
        new = tuple(reversed(kept[len(action.preconditions) :]))
        extra[action] = tuple(condition for condition in extra.get(action, new) if condition in new)
    return extra


def _held(
    sequence: Sequence[Step], inferences: Sequence[Inference], things: Sequence[str]
) -> Iterator[frozenset[Behavior]]:
    """Return what the actions so far have established and not undone, before each action of a demonstration."""
    done, held = carried(inferences, sequence, things), frozenset[Behavior]()
    for action in done.actions:
        yield frozenset(done.meaning[condition] for condition in held)
        held = frozenset(c for c in held if not undoes(action, c)) | frozenset(action.postconditions)
