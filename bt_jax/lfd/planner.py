"""A Behavior Tree from a goal, by backchaining (Colledanchise, Almeida and Ögren, Towards Blended Reactive Planning and
Acting using Behavior Trees, 2019), without a state: every condition that is not sure to hold is followed by what achieves
it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, Tree
from bt_jax.lfd.conflicts import undoes
from bt_jax.tasks import Task

__all__ = ["fold_moves", "plan", "plan_task"]

MAX_DEPTH = 40  # conditions that wait for each other, one inside the other
GIVEN = ("reachable", "clear")  # conditions that an action checks itself, and that no action is there to achieve


def plan(
    goal: Sequence[Behavior],
    *,
    actions: Iterable[Behavior] = (),
    extra: Mapping[Behavior, tuple[Behavior, ...]] | None = None,
) -> Tree:
    """Return a tree that achieves all conditions of a goal, from wherever it is ticked.

    `actions` may be used besides those that the goal itself suggests (open and close the gripper, pick and place); `extra`
    are preconditions beyond the actions' own, for instance from `constraints.preconditions`. Deterministic: the cheapest
    action that achieves a condition is taken, the first of equals. Where a later part would undo an earlier condition, it is
    moved before it. Raise UserError if no action achieves a condition, or if the parts undo each other in a circle.
    """
    planner = _Planner(tuple(actions), extra or {})
    wanted = [condition for condition in goal if not _follows(condition, goal)]
    parts = planner.ordered([planner.achieved(condition, ()) for condition in wanted])
    tree = _needed(_control(Kind.SEQUENCE, [part.tree for part in parts]), frozenset())
    if tree is None:
        raise UserError("there is nothing to achieve; give a goal")
    return fold_moves(tree)


def plan_task(task: Task) -> Tree:
    """Return a tree that brings every object of a task to its target."""
    return plan([Behavior("at", (target.object, target.position, target.frame)) for target in task.targets])


def fold_moves(tree: Tree) -> Tree:
    """Replace every subtree that is what a `move` gene stands for by that gene."""
    if not isinstance(tree, Control):
        return tree
    first = tree.children[0]
    if isinstance(first, Behavior) and first.name == "at":
        gene = Behavior("move", first.args)
        if gene.subtree == tree:
            return gene
    return _control(tree.kind, [fold_moves(child) for child in tree.children])


def _follows(condition: Behavior, goal: Sequence[Behavior]) -> bool:
    """Return whether a condition of the gripper holds anyway once the rest of the goal has been placed."""
    placed = [Behavior("place", other.args) for other in goal if other.name == "at"]
    return condition.name != "at" and any(condition in action.postconditions for action in placed)


@dataclasses.dataclass(frozen=True)
class _Part:
    """The subtree that achieves a condition."""

    condition: Behavior
    tree: Tree

    def disturbs(self, known: frozenset[Behavior], condition: Behavior, levels: int) -> bool:
        """Return whether achieving it where all of `known` hold may undo that condition; of conditions that wait for
        each other, so many `levels` are looked at."""
        left = _needed(self.tree, known)
        return left is not None and any(undoes(action, condition) for action in _actions(left, levels))


@dataclasses.dataclass(frozen=True)
class _Planner:
    actions: tuple[Behavior, ...]
    extra: Mapping[Behavior, tuple[Behavior, ...]]
    parts: dict[Behavior, _Part] = dataclasses.field(default_factory=dict)  # planned so far, by their condition

    def achieved(self, condition: Behavior, waiting: tuple[Behavior, ...]) -> _Part:
        """Check the condition, and achieve it if it does not hold; `waiting` are the conditions that this is for."""
        if condition in waiting:
            circle = " needs ".join(map(str, (*waiting[waiting.index(condition) :], condition)))
            raise UserError(f"the goal cannot be planned: {circle}; change the demonstrations or the targets")
        if len(waiting) >= MAX_DEPTH:
            raise UserError(f"planning {condition} goes {MAX_DEPTH} conditions deep; demonstrate smaller subtasks")
        if condition in self.parts:
            return self.parts[condition]
        action = self.cheapest(condition)
        waiting = (*waiting, condition)
        needed = [*action.preconditions, *self.extra.get(action, ())]
        needed = [other for other in needed if other.name not in GIVEN]
        parts = [self.achieved(other, waiting) for other in dict.fromkeys(needed)]
        own = len([other for other in action.preconditions if other.name not in GIVEN])
        # What the action itself needs of the gripper comes last: whatever else must hold first may use the gripper.
        parts = self.ordered([*parts[own:], *parts[:own]])
        attempt = _control(Kind.SEQUENCE, [*(part.tree for part in parts), action])
        self.parts[condition] = _Part(condition, _control(Kind.FALLBACK, [condition, attempt]))
        return self.parts[condition]

    def cheapest(self, condition: Behavior) -> Behavior:
        found = [action for action in (*self.actions, *_suggested(condition)) if condition in action.postconditions]
        if not found:
            raise UserError(f"no action achieves {condition}; leave it out of the goal, or give an action that does")
        return min(found, key=lambda action: action.cost)

    def ordered(self, parts: Sequence[_Part]) -> list[_Part]:
        """Return the parts in the given order, except that one which disturbs an earlier condition comes before that."""
        done: list[_Part] = []
        left = list({part.condition: part for part in parts}.values())
        while left:
            known = frozenset(part.condition for part in done)
            # Deep inside, a part may have means for a situation that does not arise after the parts before it. So where all
            # of what it may do leaves no order, what it does first decides.
            ranked = (self.undisturbed(left, known, levels) for levels in (MAX_DEPTH, 2, 1))
            free = next((part for part in ranked if part is not None), None)
            if free is None and all(part.condition.name == "at" for part in left):
                names = ", ".join(str(part.condition) for part in left)
                raise UserError(f"each of {names} undoes another; give one of them another frame")
            free = free or left[0]
            left.remove(free)
            done.append(free)
        return done

    def undisturbed(self, parts: Sequence[_Part], known: frozenset[Behavior], levels: int) -> _Part | None:
        """Return the first part whose condition none of the others, coming after it, undoes."""
        for part in parts:
            holds = known | {part.condition}
            if not any(other.disturbs(holds, part.condition, levels) for other in parts if other is not part):
                return part
        return None


def _needed(tree: Tree, known: frozenset[Behavior]) -> Tree | None:
    """Return the tree without what is known to hold where it is ticked, None if nothing is left of it.

    A memoryless Sequence ticks a child only once those before it have succeeded in the same tick, so that what they check
    or achieve holds there.
    """
    if isinstance(tree, Behavior):
        return None if tree in known else tree
    assert isinstance(tree, Control)  # plans have no other nodes
    if tree.kind == Kind.FALLBACK:
        if tree.children[0] in known:
            return None
        kept = [_needed(child, known) for child in tree.children]
        return _control(tree.kind, [child for child in kept if child is not None])
    needed: list[Tree] = []
    for child in tree.children:
        if (part := _needed(child, known)) is not None:
            needed.append(part)
        known |= _established(child)
    return _control(tree.kind, needed) if needed else None


def _established(tree: Tree) -> frozenset[Behavior]:
    """Return the conditions that hold once a part of a plan has succeeded."""
    if isinstance(tree, Behavior):
        return frozenset([tree] if tree.kind == Kind.CONDITION else tree.postconditions)
    assert isinstance(tree, Control)
    if tree.kind == Kind.FALLBACK:
        return _established(tree.children[0])
    return frozenset().union(*map(_established, tree.children))


def _actions(tree: Tree, levels: int) -> Iterator[Behavior]:
    """Yield the actions of a part of a plan, down to so many placements that wait for each other."""
    if isinstance(tree, Behavior):
        if tree.kind == Kind.ACTION:
            yield tree
        return
    assert isinstance(tree, Control)
    first = tree.children[0]
    levels -= tree.kind == Kind.FALLBACK and isinstance(first, Behavior) and first.name == "at"
    if levels >= 0:
        for child in tree.children:
            yield from _actions(child, levels)


def _suggested(condition: Behavior) -> list[Behavior]:
    """Return the actions that a condition itself names."""
    match condition.name:
        case "at":
            return [Behavior("place", condition.args)]
        case "holding" if condition.object != "nothing":
            return [Behavior("pick", condition.args)]
        case "holding":
            return [Behavior("open_gripper")]
        case "gripper":
            return [Behavior(f"{'open' if condition.args[0] == 'open' else 'close'}_gripper")]
    return []


def _control(kind: Kind, parts: Sequence[Tree]) -> Tree:
    """Return a control node; one child stands for itself, and children of the same kind dissolve into it."""
    flat: list[Tree] = []
    for part in parts:
        flat += part.children if isinstance(part, Control) and part.kind == kind else [part]
    return flat[0] if len(flat) == 1 else Control(kind, tuple(flat))
