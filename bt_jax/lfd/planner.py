"""A Behavior Tree from a goal, by backchaining (Colledanchise, Almeida and Ögren, Towards Blended Reactive Planning and
Acting using Behavior Trees, 2019), without a state: every condition that is not sure to hold is followed by what achieves
it. What stands in the way is known from the task's layouts (`obstacles`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior, Control, Kind, Tree, expand
from bt_jax.encoding.walk import leaves
from bt_jax.lfd.conflicts import undoes
from bt_jax.lfd.obstacles import Obstacles
from bt_jax.lfd.robust import patient
from bt_jax.tasks import Task
from bt_jax.tasks.roadmap import roadmap

__all__ = ["fold_moves", "plan", "plan_task"]

MAX_DEPTH = 40  # conditions that wait for each other, one inside the other
GIVEN = ("reachable", "clear")  # what an action checks itself; the obstacles say how a box becomes clear


def plan(
    goal: Sequence[Behavior],
    *,
    actions: Iterable[Behavior] = (),
    extra: Mapping[Behavior, tuple[Behavior, ...]] | None = None,
    obstacles: Obstacles | None = None,
    parts: Collection[str] = (),
    drives: bool = False,
) -> Tree:
    """Return a tree that achieves all conditions of a goal, from wherever it is ticked.

    `actions` may be used besides those that the goal itself suggests (open and close the gripper, pick and place); `extra`
    are preconditions beyond the actions' own, for instance from `constraints.preconditions`. `obstacles` are those in a
    task's layouts: they are put out of the way, and the goal may ask for its subgoals and for objects to be clear. `parts`
    are names that stand for any of several interchangeable objects. A robot that `drives` approaches what it picks up, and
    where it places it.
    Deterministic: the cheapest action that achieves a condition is taken, the first of equals. Where a later part would undo
    an earlier condition, it is moved before it. Raise UserError if no action achieves a condition, if the parts undo each
    other in a circle, or if no place is free for an obstacle.
    """
    planner = _Planner(tuple(actions), extra or {}, obstacles, parts, drives)
    if obstacles is not None:
        # clear(X) already holds while what was on X hangs in the gripper, so it is not what the tree checks.
        goal = [part for one in goal for part in (obstacles.needed(one) if one.name == "clear" else (one,))]
    tree = planner.sequence([condition for condition in goal if not _follows(condition, goal)], ())
    if tree is None:
        raise UserError("there is nothing to achieve; give a goal")
    return fold_moves(tree)


def plan_task(task: Task) -> Tree:
    """Return a tree that brings every object of a task to its target, and reaches its subgoals before; where things go
    wrong, a `patient` one.

    What may be in the way, but is not in every layout, is left where it is if there are not enough ticks in an episode to
    put it aside, and so are subgoals. Raise UserError if no place is free for an obstacle.
    """
    every, certain = Obstacles(task), Obstacles(task, certain=True)
    targets = list(every.goals.values())
    subgoals = [Behavior("reached", (subgoal.name,)) for subgoal in task.subgoals]
    if task.subgoal_reward == "seen":
        subgoals = [subgoal for subgoal in subgoals if every.needed(subgoal)]
    for wanted, obstacles in (([*subgoals, *targets], every), ([*subgoals, *targets], certain), (targets, certain)):
        tree = plan([*wanted, *obstacles.anchored], obstacles=obstacles, drives=task.robot.base is not None)
        if _longest(task, tree) + task.episode.success_ticks <= task.episode.max_ticks:
            break
    return tree if task.faults is None else patient(tree, task)


def _longest(task: Task, tree: Tree) -> int:
    """Return how many ticks a plan acts in at most: a pick and a placement for each place in it, and two drives."""
    drive = 0 if task.robot.base is None else roadmap(task).longest
    return 2 * (1 + drive) * len({leaf for leaf in leaves(expand(tree)) if leaf.name == "place"})


def fold_moves(tree: Tree) -> Tree:
    """Replace every subtree that is what a `move` or `carry` gene stands for by that gene, also where more has to hold
    before the object is picked: then the gene follows that."""
    if not isinstance(tree, Control):
        return tree
    first, last = tree.children[0], tree.children[-1]
    if isinstance(first, Behavior) and first.name == "at":
        for gene, parts in ((Behavior("move", first.args), 2), (Behavior("carry", first.args), 3)):
            if gene.subtree == tree:
                return gene
            if isinstance(last, Control) and gene.subtree == Control.fallback(
                first, _control(last.kind, last.children[-parts:])
            ):
                before = last.children[:-parts]
                if not before:  # the gene itself begins with the first condition
                    return Control.fallback(*tree.children[1:-1], gene)
                tree = Control.fallback(*tree.children[:-1], Control(last.kind, (*before, gene)))
                break
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


@dataclasses.dataclass(frozen=True)
class _Planner:
    actions: tuple[Behavior, ...]
    extra: Mapping[Behavior, tuple[Behavior, ...]]
    obstacles: Obstacles | None
    interchangeable: Collection[str]
    drives: bool
    parts: dict[Behavior, _Part] = dataclasses.field(default_factory=dict)  # planned so far, by their condition

    def achieved(self, condition: Behavior, waiting: tuple[Behavior, ...]) -> _Part:
        """Check the condition, and achieve it if it does not hold; `waiting` are the conditions that this is for."""
        if condition in waiting:
            circle = " needs ".join(map(str, (*waiting[waiting.index(condition) :], condition)))
            raise UserError(f"the goal cannot be planned: {circle}; change the demonstrations or the targets")
        if len(waiting) >= MAX_DEPTH:
            raise UserError(f"planning {condition} goes {MAX_DEPTH} conditions deep; demonstrate smaller subtasks")
        if condition not in self.parts:
            attempt = self.attempt(condition, (*waiting, condition))
            elsewhere = self.obstacles.alternatives(condition) if self.obstacles else ()
            fallback = [condition] if attempt is None else [condition, *elsewhere, attempt]
            self.parts[condition] = _Part(condition, _control(Kind.FALLBACK, fallback))
        return self.parts[condition]

    def attempt(self, condition: Behavior, waiting: tuple[Behavior, ...]) -> Tree | None:
        """Return what makes a condition hold; None for a subgoal that holds as long as nothing has been moved."""
        if condition.name == "reached" and self.obstacles is not None:
            wanted = self.obstacles.needed(condition)
            return self.sequence([other for other in wanted if not _follows(other, wanted)], waiting)
        action = self.cheapest(condition)
        before = [*self.extra.get(action, ()), *(self.obstacles.needed(action) if self.obstacles else ())]
        # What the action itself needs of the gripper comes last: whatever else must hold first may use the gripper.
        needed = [other for other in (*before, *action.preconditions) if other.name not in GIVEN]
        if self.drives and action.within_reach is not None:
            needed.append(action.within_reach)
        return self.sequence(needed, waiting, action)

    def sequence(self, conditions: Iterable[Behavior], waiting: tuple[Behavior, ...], *then: Behavior) -> Tree | None:
        """Return what achieves conditions, and an action after them; None if there is nothing to do."""
        parts = self.ordered([self.achieved(other, waiting) for other in dict.fromkeys(conditions)])
        return self.remaining(_control(Kind.SEQUENCE, [*(part.tree for part in parts), *then]), frozenset())

    def cheapest(self, condition: Behavior) -> Behavior:
        found = [action for action in (*self.actions, *_suggested(condition)) if condition in action.postconditions]
        if not found:
            raise UserError(f"no action achieves {condition}; leave it out of the goal, or give an action that does")
        return min(found, key=lambda action: action.cost)

    def ordered(self, parts: Sequence[_Part]) -> list[_Part]:
        """Return the parts in the given order, except that one which disturbs an earlier condition comes before that, that
        subgoals, which are on the way, come first, and then those for which the fewest obstacles must be put aside."""
        done: list[_Part] = []
        left = list({part.condition: part for part in parts}.values())
        while left:
            known = frozenset().union(*(self.established(part.condition) for part in done))
            ranked = sorted(left, key=lambda part: self.effort(part, known))
            # Deep inside, a part may have means for a situation that does not arise after the parts before it. So where all
            # of what it may do leaves no order, what it does first decides.
            depths = (MAX_DEPTH, 2, 1)
            free = (part for levels in depths for part in ranked if self.is_undisturbed(part, left, known, levels))
            chosen = next(free, None)
            if chosen is None and all(part.condition.name == "at" for part in left):
                names = ", ".join(str(part.condition) for part in left)
                raise UserError(f"each of {names} undoes another; give one of them another frame")
            chosen = chosen or left[0]
            left.remove(chosen)
            done.append(chosen)
        return done

    def effort(self, part: _Part, known: frozenset[Behavior]) -> tuple[bool, int]:
        """Return whether a part is no subgoal, and how many obstacles it puts aside where all of `known` hold."""
        tree, obstacles = self.remaining(part.tree, known), self.obstacles
        if tree is None or obstacles is None:
            return part.condition.name != "reached", 0
        return part.condition.name != "reached", len({leaf for leaf in leaves(tree) if obstacles.is_aside(leaf)})

    def is_undisturbed(self, part: _Part, parts: Sequence[_Part], known: frozenset[Behavior], levels: int) -> bool:
        """Return whether none of the other parts, coming after one, undoes its condition."""
        holds = known | self.established(part.condition)
        return not any(self.disturbs(other, holds, part.condition, levels) for other in parts if other is not part)

    def disturbs(self, part: _Part, known: frozenset[Behavior], condition: Behavior, levels: int) -> bool:
        """Return whether achieving a part where all of `known` hold may undo a condition; of conditions that wait for
        each other, so many `levels` are looked at."""
        left = self.remaining(part.tree, known)
        return left is not None and any(self.undoes(action, condition) for action in _actions(left, levels))

    def undoes(self, action: Behavior, condition: Behavior) -> bool:
        if self.obstacles is not None:
            return self.obstacles.undoes(action, condition)
        return undoes(action, condition, parts=self.interchangeable)

    def remaining(self, tree: Tree, known: frozenset[Behavior]) -> Tree | None:
        """Return the tree without what is known to hold where it is ticked, None if nothing is left of it.

        A memoryless Sequence ticks a child only once those before it have succeeded in the same tick, so that what they
        check or achieve holds there.
        """
        if isinstance(tree, Behavior):
            return None if self.holds(tree, known) else tree
        assert isinstance(tree, Control)  # plans have no other nodes
        if tree.kind == Kind.FALLBACK:
            first = tree.children[0]
            if isinstance(first, Behavior) and self.holds(first, known):
                return None
            parts = [self.remaining(child, known) for child in tree.children]
            return _control(tree.kind, [part for part in parts if part is not None])
        kept: list[Tree] = []
        for child in tree.children:
            if (part := self.remaining(child, known)) is not None:
                kept.append(part)
            known |= self.established(child)
        return _control(tree.kind, kept) if kept else None

    def holds(self, condition: Behavior, known: frozenset[Behavior]) -> bool:
        """Return whether a condition is known to hold, an obstacle being out of the way at any of the plan's places."""
        return condition in known or (self.obstacles is not None and self.obstacles.is_away(condition, known))

    def established(self, tree: Tree) -> frozenset[Behavior]:
        """Return the conditions that hold once a part of a plan has succeeded."""
        if isinstance(tree, Behavior):
            if tree.kind != Kind.CONDITION:
                return frozenset(tree.postconditions)
            return frozenset([tree]) | (self.obstacles.implied(tree) if self.obstacles else frozenset())
        assert isinstance(tree, Control)
        if tree.kind == Kind.FALLBACK:
            return self.established(tree.children[0])
        return frozenset().union(*map(self.established, tree.children))


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
        case "reachable":
            return [Behavior("approach", condition.args)]
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
