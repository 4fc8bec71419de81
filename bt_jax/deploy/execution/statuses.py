"""What every leaf of a tree returns on the robot, from what is known of the world. The meaning of the leaves is that of the
simulation (`mjx_env.semantics`); what is added is what the simulation never meets: not knowing, and actions that take time.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import NOTHING, OPEN, Behavior, Kind, subgoal_conditions
from bt_jax.behaviors.geometry import is_at, is_reachable
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.planning.pose_geometry import plain, stands_on
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["Context", "Statuses", "subgoals_by_sight"]

OPENED = 0.9  # share of its stroke from which a gripper counts as open


@dataclasses.dataclass(frozen=True)
class Context:
    """What the status of a leaf depends on besides the world."""

    attempt: Behavior | None = None  # the action that is being carried out
    exhausted: frozenset[Behavior] = frozenset()  # actions that were tried too often
    reached: frozenset[str] = frozenset()  # subgoals that count as reached
    unreachable: frozenset[str] = frozenset()  # boxes that no arm can grasp where they are
    last: Mapping[str, RigidTransform] | None = (
        None  # where each object was seen last, in the base frame; None: not asked
    )


class Statuses:
    """Leaf statuses for one tick. `undecided` collects the conditions that were asked and cannot be decided, `ticked` the
    subgoals that count as reached from now on since the tree asked for them."""

    def __init__(self, task: Task, seen: Observation, context: Context) -> None:
        self.task, self.seen, self.context = task, seen, context
        self.undecided: list[Behavior] = []
        self.ticked: set[str] = set()
        self._lowest = min(table.top for table in task.tables) - task.robot_position[2]

    def __call__(self, leaf: Behavior, _: int) -> Status:
        """Return the status of a condition or an action, as `encoding.interpret.tick_tree` asks for it."""
        if leaf.kind == Kind.CONDITION:
            return Status.SUCCESS if self.holds(leaf) else Status.FAILURE
        if all(self.holds(post) for post in leaf.postconditions):
            return Status.SUCCESS
        if leaf in self.context.exhausted:
            return Status.FAILURE
        if leaf == self.context.attempt:
            return Status.RUNNING if self._goes_on(leaf) else Status.FAILURE
        return Status.RUNNING if all(self.holds(pre) for pre in leaf.preconditions) else Status.FAILURE

    def holds(self, condition: Behavior) -> bool:
        """Is it known to be true?"""
        known, name = self._known(condition), condition.object or ""
        if not known or (condition.name == "clear" and self._may_be_covered(name)):
            self.undecided.append(condition)
        match condition.name:
            case "at":
                in_hand = self.seen.holding == condition.object
                return known and not in_hand and self._is_at(condition)
            case "holding":
                wanted = condition.object
                return self.seen.holding is None if wanted == NOTHING else self.seen.holding == wanted
            case "gripper":
                least = OPENED * self.task.gripper_opening
                opened = all(opening >= least for opening in self.seen.opening.values())
                return opened == (condition.args[0] == OPEN)
            case "reachable":
                return known and self._in_reach(name)
            case "clear":
                return known and not any(
                    self._rests_on(other, name, self.seen.poses) for other in self.task.object_names
                )
            case "reached":
                return self._is_reached(str(condition.args[0]))
        raise ValueError(f"{condition} is no condition")

    def _is_reached(self, subgoal: str) -> bool:
        if subgoal in self.context.reached or self.task.subgoal_reward == "seen":
            return subgoal in self.context.reached
        holds = all(map(self.holds, subgoal_conditions(self.task)[subgoal]))
        if holds:
            self.ticked.add(subgoal)
        return holds

    def _known(self, condition: Behavior) -> bool:
        """Are the poses known that the condition speaks of? That of a held box is not needed: it is in the hand."""
        needed = [condition.object, condition.frame] if condition.name in ("at", "reachable", "clear") else []
        certain = (None, self.task.robot_frame, self.seen.holding)
        return all(name in certain or name in self.seen.poses for name in needed)

    def _goes_on(self, action: Behavior) -> bool:
        """May an action that is under way go on? An arm hides what it reaches for, so that only knowledge against it
        counts."""
        if action.name == "place":
            return self.seen.holding == action.object
        if action.name != "pick" or action.object not in self.seen.poses:
            return True
        return all(self.holds(pre) for pre in action.preconditions if pre.name in ("clear", "reachable"))

    def _is_at(self, at: Behavior) -> bool:
        """Is the object where it should be? False if one of them is in the hand and not seen."""
        poses = self.seen.poses
        if at.object is None or at.frame is None or at.object not in poses:
            return False
        frame = RigidTransform.identity() if at.frame == self.task.robot_frame else poses.get(at.frame)
        if frame is None:
            return False
        thing, pose = self.task.thing(at.object), plain(poses[at.object])
        place = at.position or (0.0, 0.0, 0.0)
        return is_at(thing, pose, plain(frame), place, turn=at.turn, episode=self.task.episode)

    def _in_reach(self, name: str) -> bool:
        return self._above_tables(name) and name not in self.context.unreachable

    def _above_tables(self, name: str) -> bool:
        if name not in self.seen.poses:  # in the hand
            return True
        return is_reachable(self.task.thing(name), float(self.seen.poses[name].translation[2]), self._lowest)

    def _may_be_covered(self, lower: str) -> bool:
        """Could a box out of sight stand on it, since it did when it was seen last, or never was seen?"""
        last, seen = self.context.last, self.seen.poses
        if last is None:
            return False
        hidden = [name for name in self.task.object_names if name not in (*seen, self.seen.holding)]
        return any(name not in last or self._rests_on(name, lower, {**last, **seen}) for name in hidden)

    def _rests_on(self, upper: str, lower: str, poses: Mapping[str, RigidTransform]) -> bool:
        """Does `upper` stand over `lower`, close enough to rest on it? A held box rests on nothing."""
        held = self.seen.holding
        if upper == lower or upper not in poses or lower not in poses or held in (upper, lower):
            return False
        return stands_on(self.task, upper, lower, poses)


def subgoals_by_sight(task: Task, seen: Observation) -> frozenset[str]:
    """Return the task's subgoals that count as reached now without a tick: by its rule all that are known to hold, or
    none."""
    if task.subgoal_reward != "seen":
        return frozenset()
    statuses = Statuses(task, seen, Context())
    meanings = subgoal_conditions(task)
    return frozenset(name for name, meaning in meanings.items() if all(map(statuses.holds, meaning)))
