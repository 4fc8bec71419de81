"""What stands in the way in the layouts of a task, and the conditions under which it does not.

No condition of a tree says what stands on a box or fills a place. But layouts say what may: a box is in the way as long as
it is where it started. It is not once it is at any place that the plan chose for it, and that is what conditions say here:
`at` its target or, for lack of anything better, `at` a place that is free in all layouts.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping

from bt_jax._util.errors import UserError
from bt_jax.behaviors import NOTHING, OPEN, Behavior, subgoal_conditions
from bt_jax.lfd.free_places import free_places
from bt_jax.lfd.placements import condition_of, target_of
from bt_jax.lfd.starts import TOUCH, above, fills, may_fill, may_start_at, start_height
from bt_jax.tasks import Target, Task
from bt_jax.tasks.support import resolve

__all__ = ["Obstacles"]

AT_REST = (Behavior("gripper", (OPEN,)), Behavior("holding", (NOTHING,)))  # after every placement, and at the start


@dataclasses.dataclass(frozen=True)
class Obstacles:
    """The obstacles of a task: those in every layout and, unless `certain`, those in some."""

    task: Task
    certain: bool = False

    def needed(self, leaf: Behavior) -> tuple[Behavior, ...]:
        """Return what has to be out of the way for a placement, what makes a box clear, or what a subgoal asks for; in an
        order in which it can be done, what stands on top first. Raise UserError if no place is free for one."""
        if leaf.name == "clear":
            return self._asides(above(self.task, str(leaf.object)), frozenset())
        if leaf.name == "reached":
            wanted = (condition for condition in self._meaning(leaf) if condition not in AT_REST)
            parts = ((other,) if other.name != "clear" else self.needed(other) for other in wanted)
            return tuple(dict.fromkeys(other for part in parts for other in part if other.name != "reachable"))
        if leaf.name != "place":
            return ()
        place = target_of(leaf)
        sure, possible = self._in_the_way(place)
        if any(resolve(self.task, place)[0] == root.object for root in self.anchored):
            sure, possible = above(self.task, place.object), frozenset()
        return self._asides(sure, frozenset() if self.certain else possible)

    @functools.cached_property
    def anchored(self) -> tuple[Behavior, ...]:
        """Return that boxes without a target, in whose frames others have theirs, are at a free place: those that are in the
        way themselves, or that have no room around them where they start."""
        found = frozenset(root for root in self._roots if any(self._must_move(root, one) for one in self.task.targets))
        return self._asides(frozenset(), found)

    def implied(self, condition: Behavior) -> frozenset[Behavior]:
        """Return what is out of the way once a condition of a plan holds, until the plan moves it: what had to be put aside
        to reach a subgoal, or before a box that has been moved itself."""
        moved: list[str] = []
        if condition.name == "at" and not may_start_at(self.task, target_of(condition)):
            moved.append(str(condition.object))
        elif condition.name == "reached" and Behavior("holding", (NOTHING,)) in self._meaning(condition):
            moved += [str(other.object) for other in self._meaning(condition) if other.name == "clear"]
        found = frozenset[str]().union(*(above(self.task, name) for name in moved))
        return frozenset(self._asides(frozenset(), found))

    def is_aside(self, condition: Behavior) -> bool:
        """Return whether a condition only says that an obstacle is out of the way, so that another place does as well."""
        place = self._free.get(str(condition.object))
        return condition.name == "at" and place is not None and condition == condition_of(place)

    def undoes(self, action: Behavior, condition: Behavior) -> bool:
        """Return whether an action needs the room below a place, or puts something else where it is."""
        if action.name != "place" or condition.name != "at" or action.object == condition.object:
            return False
        lower, upper = target_of(action), target_of(condition)
        (root, a), (other, b) = resolve(self.task, lower), resolve(self.task, upper)
        reach = (self.task.edge(lower.object) + self.task.edge(upper.object)) / 2 - TOUCH
        return root == other and a[2] < b[2] and max(abs(a[0] - b[0]), abs(a[1] - b[1])) < reach

    def _meaning(self, reached: Behavior) -> tuple[Behavior, ...]:
        return subgoal_conditions(self.task)[str(reached.args[0])]

    def _asides(self, sure: frozenset[str], possible: frozenset[str]) -> tuple[Behavior, ...]:
        """Return that boxes are at their free places, the highest first; possible obstacles as far as there are places."""
        for name in self.task.object_names:
            if name in sure and name not in self._free:
                raise UserError(
                    f"task {self.task.name}: no place is free in all layouts to put {name} out of the way; make the kit or "
                    "a table larger"
                )
        found = [name for name in self.task.object_names if name in sure | possible and name in self._free]
        found.sort(key=lambda name: start_height(self.task, name), reverse=True)
        return tuple(condition_of(self._free[name]) for name in found)

    @functools.cached_property
    def _free(self) -> Mapping[str, Target]:
        """Free places for all boxes that may have to be put out of the way."""
        found = frozenset(self._roots).union(*(above(self.task, name) for name in self.task.object_names))
        for target in self.task.targets:
            found = found.union(*self._in_the_way(target))
        return free_places(self.task, [name for name in self.task.object_names if name in found])

    @functools.cached_property
    def _roots(self) -> frozenset[str]:
        """The boxes without a target in whose frames others have theirs."""
        return frozenset(resolve(self.task, target)[0] for target in self.task.targets) & frozenset(
            self.task.object_names
        )

    def _in_the_way(self, place: Target) -> tuple[frozenset[str], frozenset[str]]:
        """Return the boxes that must be moved for a placement in all layouts, and in some."""
        over = above(self.task, place.object)
        return over | self._filling(place, fills), self._filling(place, may_fill)

    def _filling(self, place: Target, fills: Callable[[Task, str, Target], bool]) -> frozenset[str]:
        """Return the boxes that fill a place, and what stands on them, but for the box that it is for."""
        found = [name for name in self.task.object_names if name != place.object and fills(self.task, name, place)]
        return frozenset().union(found, *(above(self.task, name) for name in found)) - {place.object}

    def _must_move(self, root: str, target: Target) -> bool:
        """Return whether a box without a target cannot stay where it starts because of the target of another."""
        sure, possible = self._in_the_way(target)
        if root in sure or (root in possible and not self.certain):
            return True
        of, (x, y, _) = resolve(self.task, target)
        if of != root:
            return False
        beside = max(abs(x), abs(y)) > (self.task.edge(root) + self.task.edge(target.object)) / 2 - TOUCH
        raised = any(root in above(self.task, name) for name in self.task.object_names)
        return (beside and raised) or (not self.certain and not possible <= sure)
