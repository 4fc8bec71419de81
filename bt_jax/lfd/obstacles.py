"""What stands in the way in the layouts of a task, and the conditions under which it does not.

No condition of a tree says what stands on an object, fills a place or leaves no room for the fingers. But layouts say what
may: an object is in the way as long as it is where it started. It is not once it is at any place that the plan chose for it,
and that is what conditions say here: `at` its target or, for lack of anything better, `at` a place that is free in all
layouts. Which instance of a part goes to which of its targets is not known, so one is out of the way at any of them.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping

from bt_jax._util.errors import UserError
from bt_jax.behaviors import NOTHING, OPEN, Behavior, subgoal_conditions
from bt_jax.lfd.conflicts import undoes
from bt_jax.lfd.extents import Extent, block_at, half_of, turn_at
from bt_jax.lfd.free_places import free_places, on_floor
from bt_jax.lfd.placements import condition_of, target_of
from bt_jax.lfd.starts import (
    TOUCH,
    above,
    beside,
    fills,
    may_fill,
    may_start_at,
    shuts_in,
    start_height,
    starts_at,
)
from bt_jax.tasks import Target, Task
from bt_jax.tasks.support import resolve, start_turn
from bt_jax.tasks.things import Vec3

__all__ = ["Obstacles"]

AT_REST = (Behavior("gripper", (OPEN,)), Behavior("holding", (NOTHING,)))  # after every placement, and at the start


@dataclasses.dataclass(frozen=True)
class Obstacles:
    """The obstacles of a task: those in every layout and, unless `certain`, those in some."""

    task: Task
    certain: bool = False

    @functools.cached_property
    def goals(self) -> Mapping[Target, Behavior]:
        """The condition that each target stands for: where an instance of a part starts in the way of a target of that part,
        it is the one that should be there."""
        found: dict[Target, Behavior] = {}
        for target in self.task.targets:
            own = self.task.instances[target.object]
            meant = [name for name in own if name not in self._settled and fills(self.task, name, target)]
            free = [name for name in meant if name not in [goal.object for goal in found.values()]]
            if len(own) == 1 or not free or any(starts_at(self.task, name, target) for name in own):
                found[target] = condition_of(target)
            else:
                found[target] = condition_of(dataclasses.replace(target, object=free[0]))
        return found

    def needed(self, leaf: Behavior) -> tuple[Behavior, ...]:
        """Return what has to be out of the way for a placement, what makes an object clear, or what a subgoal asks for; in
        an order in which it can be done, what stands on top first. Raise UserError if no place is free for one."""
        if leaf.name == "clear":
            return self._asides(self._covering(str(leaf.object)), frozenset())
        if leaf.name == "reached":
            wanted = (condition for condition in self._meaning(leaf) if condition not in AT_REST)
            parts = ((other,) if other.name != "clear" else self.needed(other) for other in wanted)
            return tuple(dict.fromkeys(other for part in parts for other in part if other.name != "reachable"))
        if leaf.name != "place":
            return ()
        place = target_of(leaf)
        sure, possible = self._in_the_way(place)
        if any(resolve(self.task, place)[0] == root.object for root in self.anchored):
            sure, possible = self._hindering(place.object), frozenset()
        return self._asides(sure, frozenset() if self.certain else possible)

    def alternatives(self, condition: Behavior) -> tuple[Behavior, ...]:
        """Return where else an instance of a part is out of the way: at the targets of its part, but for those on objects
        that it starts on."""
        name = str(condition.object)
        part = self.task.thing(name).part if self.is_aside(condition) else ""
        places = (dataclasses.replace(one, object=name) for one in self.task.targets
                  if part and one.object == part and not self._starts_on(name, one.frame))  # fmt: skip
        return tuple(map(condition_of, places))

    @functools.cached_property
    def anchored(self) -> tuple[Behavior, ...]:
        """Return that objects without a target, in whose frames others have theirs, are at a free place: those that are in
        the way themselves, or that have no room around them where they start."""
        found = frozenset(root for root in self._roots if any(self._must_move(root, one) for one in self.task.targets))
        return self._asides(frozenset(), found)

    def implied(self, condition: Behavior) -> frozenset[Behavior]:
        """Return what is out of the way once a condition of a plan holds, until the plan moves it: what had to be put aside
        to reach a subgoal, or before an object that has been moved itself."""
        moved: list[str] = []
        if condition.name == "at" and not may_start_at(self.task, target_of(condition)):
            moved += [str(condition.object)] if condition.object in self.task.object_names else []
        elif condition.name == "reached" and Behavior("holding", (NOTHING,)) in self._meaning(condition):
            moved += [str(other.object) for other in self._meaning(condition) if other.name == "clear"]
        found = frozenset[str]().union(*(above(self.task, name) for name in moved))
        return frozenset(self._asides(frozenset(), found))

    def is_aside(self, condition: Behavior) -> bool:
        """Return whether a condition only says that an obstacle is out of the way, so that another place does as well."""
        place = self._free.get(str(condition.object))
        return condition.name == "at" and place is not None and condition == condition_of(place)

    def is_away(self, condition: Behavior, known: frozenset[Behavior]) -> bool:
        """Return whether an obstacle is known to be out of the way at another place than a condition says: at any of the
        plan's, or at a target of its part, if all instances are needed there."""
        if not self.is_aside(condition):
            return False
        if any(other.name == "at" and other.object == condition.object for other in known):
            return True
        name = str(condition.object)
        part = self.task.thing(name).part
        goals = [goal for target, goal in self.goals.items() if part and target.object == part]
        moved = not any(self._starts_on(name, str(goal.frame)) for goal in goals)
        return bool(goals) and moved and len(goals) == len(self.task.instances[part]) and known.issuperset(goals)

    def undoes(self, action: Behavior, condition: Behavior) -> bool:
        """Return whether an action may move what a condition is about or the frame of its place, needs the room below that
        place, or puts something else where it is. An instance in a target of its part is not taken for another target."""
        if undoes(action, condition, parts=self._parts):
            return True
        if condition.name != "at" or action.name not in ("pick", "place"):
            return False
        if condition.frame in self.task.instances[str(action.object)]:
            return True
        if action.name == "pick":
            return False
        if action.object != condition.object and action.object in self.task.instances[str(condition.object)]:
            # It is only put aside where it is at no target of its part.
            return Behavior("at", action.args) in self.goals.values()
        lower, upper = target_of(action), target_of(condition)
        (root, a), (other, b) = resolve(self.task, lower), resolve(self.task, upper)
        if root != other or a[2] >= b[2]:
            return False
        return _block(self.task, lower, a).gap(_block(self.task, upper, b)) < -TOUCH

    def _starts_on(self, name: str, frame: str) -> bool:
        """Return whether an object starts on another, so that a place on that says nothing about having been moved."""
        return frame in self.task.object_names and name in above(self.task, frame)

    def _meaning(self, reached: Behavior) -> tuple[Behavior, ...]:
        return subgoal_conditions(self.task)[str(reached.args[0])]

    def _asides(self, sure: frozenset[str], possible: frozenset[str]) -> tuple[Behavior, ...]:
        """Return that objects are at their free places, or at their targets in a kit where no place is free, the highest
        first; possible obstacles as far as there are free places."""
        own = {str(goal.object): goal for target, goal in self.goals.items() if on_floor(self.task, target)}
        places = {name: own[name] for name in sure & own.keys()}
        places |= {name: condition_of(place) for name, place in self._free.items()}
        for name in self.task.object_names:
            if name in sure and name not in places:
                raise UserError(
                    f"task {self.task.name}: no place is free in all layouts to put {name} out of the way; make the kit or "
                    "a table larger"
                )
        found = [name for name in self.task.object_names if name in sure | possible and name in places]
        found.sort(key=lambda name: start_height(self.task, name), reverse=True)
        return tuple(places[name] for name in found)

    @functools.cached_property
    def _free(self) -> Mapping[str, Target]:
        """Free places for all objects that may have to be put out of the way."""
        found = frozenset(self._roots).union(*(self._hindering(name) for name in self.task.object_names))
        for target in self.task.targets:
            found = found.union(*self._in_the_way(target))
        return free_places(self.task, [name for name in self.task.object_names if name in found])

    @functools.cached_property
    def _roots(self) -> frozenset[str]:
        """The objects without a target in whose frames others have theirs."""
        return frozenset(resolve(self.task, target)[0] for target in self.task.targets) & frozenset(
            self.task.object_names
        )

    def _in_the_way(self, place: Target) -> tuple[frozenset[str], frozenset[str]]:
        """Return the objects that must be moved for a placement in all layouts, and in some."""
        sure, possible = (self._filling(place, one) for one in (fills, may_fill))
        return sure | self._hindering(place.object) | self._shut_in(place), possible

    def _filling(self, place: Target, fills: Callable[[Task, str, Target], bool]) -> frozenset[str]:
        """Return the objects that fill a place, and what stands on them, but for those that it is for."""
        own = self.task.instances[place.object]
        found = [name for name in self.task.object_names if name not in own and fills(self.task, name, place)]
        return frozenset().union(found, *(above(self.task, name) for name in found)) - frozenset(own)

    def _covering(self, name: str) -> frozenset[str]:
        """Return what stands on an object, or on all instances of a part, where too few others are clear."""
        return self._enough(name, lambda one: above(self.task, one))

    def _hindering(self, name: str) -> frozenset[str]:
        """Return what keeps the gripper from an object, or from too many instances of a part."""
        return self._enough(name, lambda one: above(self.task, one) | beside(self.task, one))

    def _enough(self, name: str, obstacles: Callable[[str], frozenset[str]]) -> frozenset[str]:
        """Return the obstacles of an object; of a part, those of all its instances unless enough of these have none."""
        own = self.task.instances[name]
        found = [obstacles(one) - frozenset(own if len(own) > 1 else ()) for one in own]
        wanted = sum(target.object == name for target in self.task.targets)
        return frozenset[str]() if found.count(frozenset()) >= max(wanted, 1) else frozenset[str]().union(*found)

    def _shut_in(self, place: Target) -> frozenset[str]:
        """Return the objects with a target that the gripper cannot take any more once something is at a place."""
        wanted = frozenset(name for target in self.task.targets for name in self.task.instances[target.object])
        return frozenset(name for name in wanted - frozenset(self.task.instances[place.object])
                         if name not in self._settled and shuts_in(self.task, place, name))  # fmt: skip

    @functools.cached_property
    def _parts(self) -> frozenset[str]:
        """The names that stand for any of several objects."""
        return frozenset(self.task.instances) - frozenset(self.task.object_names)

    @functools.cached_property
    def _settled(self) -> frozenset[str]:
        """The objects that start in a target of theirs."""
        return frozenset(
            name
            for target in self.task.targets
            for name in self.task.instances[target.object]
            if starts_at(self.task, name, target)
        )

    def _must_move(self, root: str, target: Target) -> bool:
        """Return whether an object without a target cannot stay where it starts because of the target of another."""
        sure, possible = self._in_the_way(target)
        if root in sure or (root in possible and not self.certain):
            return True
        of, offset = resolve(self.task, target)
        if of != root:
            return False
        own = block_at((0.0, 0.0, 0.0), self.task.thing(root).half_at(None))
        beside = own.gap(_block(self.task, target, offset)) > -TOUCH
        raised = any(root in above(self.task, name) for name in self.task.object_names)
        return (beside and raised) or (not self.certain and not possible <= sure)


def _block(task: Task, place: Target, position: Vec3) -> Extent:
    """Return what an object fills at a place, where its position is given in the frame that its chain begins with."""
    root, turn = resolve(task, place)[0], turn_at(task, place)
    of_root = start_turn(task, root) if root in task.object_names else 0.0
    within = None if turn is None or of_root is None else turn - of_root
    return block_at(position, half_of(task, place.object, within))
