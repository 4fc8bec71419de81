"""What every leaf of a tree returns on the robot, from what is known of the world. The meaning of the leaves is that of the
simulation (`mjx_env.semantics`); what is added is what the simulation never meets: not knowing, and actions that take time.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import NOTHING, OPEN, Behavior, Kind, subgoal_conditions
from bt_jax.behaviors.geometry import can_be_taken, in_own_target, is_at, is_reachable
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
    unreachable: frozenset[str] = frozenset()  # objects that no arm can grasp where they are
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
        possible = all(self.holds(pre) for pre in leaf.preconditions)
        if possible and leaf.name == "pick":
            possible = bool(self.candidates(leaf.object or ""))
        return Status.RUNNING if possible else Status.FAILURE

    def holds(self, condition: Behavior) -> bool:
        """Is it known to be true, of any instance where it names a part?"""
        name = condition.object or ""
        match condition.name:
            case "at" | "reachable" | "clear":
                found = [self._judge(condition, one) for one in self.task.instances[name]]
                if not (all(sure for _, sure in found) or any(true and sure for true, sure in found)):
                    self.undecided.append(condition)
                return any(true for true, _ in found)
            case "holding":
                return self.seen.holding in ((None,) if name == NOTHING else self.task.instances[name])
            case "gripper":
                least = OPENED * self.task.gripper_opening
                opened = all(opening >= least for opening in self.seen.opening.values())
                return opened == (condition.args[0] == OPEN)
            case "is_seen":
                seen = any(map(self._knows, self.task.instances[name]))
                attempt = self.context.attempt
                if not seen and attempt is not None and attempt.name != "look":  # an arm may hide it
                    self.undecided.append(condition)
                return seen
            case "reached":
                return self._is_reached(str(condition.args[0]))
        raise ValueError(f"{condition} is no condition")

    def candidates(self, name: str) -> list[str]:
        """Return the objects that a `pick` may take that are seen, the nearest to the robot first: clear, within reach and
        graspable; of a part, none that stands in a target of its own."""
        poses = {one: plain(pose) for one, pose in self.seen.poses.items()}
        poses[self.task.robot_frame] = plain(RigidTransform.identity())
        done = () if name in self.task.object_names else in_own_target(self.task, poses, held=self.seen.holding)
        found = [
            one
            for one in self.task.instances[name]
            if one in poses
            and one not in done
            and one not in self.context.unreachable
            and can_be_taken(self.task, poses, one, held=self.seen.holding)
        ]
        return sorted(found, key=lambda one: math.hypot(*poses[one].position[:2]))

    def _judge(self, condition: Behavior, name: str) -> tuple[bool, bool]:
        """Return whether a condition is known to be true of one object, and whether what is known decides it."""
        known = self._knows(name) and (condition.frame is None or self._knows(condition.frame))
        match condition.name:
            case "at":
                return known and self.seen.holding != name and self._is_at(condition, name), known
            case "reachable":
                return known and self._in_reach(name), known
        covered = any(self._rests_on(other, name, self.seen.poses) for other in self.task.object_names)
        return known and not covered, known and not self._may_be_covered(name)

    def _is_reached(self, subgoal: str) -> bool:
        if subgoal in self.context.reached or self.task.subgoal_reward == "seen":
            return subgoal in self.context.reached
        holds = all(map(self.holds, subgoal_conditions(self.task)[subgoal]))
        if holds:
            self.ticked.add(subgoal)
        return holds

    def _knows(self, name: str) -> bool:
        """Is it known where something is? What is held is in the hand, whether it is seen or not."""
        return name in self.seen.poses or name in (self.task.robot_frame, self.seen.holding)

    def _goes_on(self, action: Behavior) -> bool:
        """May an action that is under way go on? An arm hides what it reaches for, so that only knowledge against it
        counts."""
        if action.name == "place":
            return self.seen.holding in self.task.instances[action.object or ""]
        if action.name != "pick" or action.object not in self.seen.poses:
            return True
        return all(self.holds(pre) for pre in action.preconditions if pre.name in ("clear", "reachable"))

    def _is_at(self, at: Behavior, name: str) -> bool:
        """Is an object where the condition says? False if it or the frame is in the hand and not seen."""
        poses = {**self.seen.poses, self.task.robot_frame: RigidTransform.identity()}
        if name not in poses or at.frame not in poses or at.position is None:
            return False
        thing, pose, frame = self.task.thing(name), plain(poses[name]), plain(poses[at.frame])
        return is_at(thing, pose, frame, at.position, turn=at.turn, episode=self.task.episode)

    def _in_reach(self, name: str) -> bool:
        return self._above_tables(name) and name not in self.context.unreachable

    def _above_tables(self, name: str) -> bool:
        if name not in self.seen.poses:  # in the hand
            return True
        return is_reachable(self.task.thing(name), float(self.seen.poses[name].translation[2]), self._lowest)

    def _may_be_covered(self, lower: str) -> bool:
        """Could something out of sight stand on it, since it did when it was seen last, or never was seen?"""
        last, seen = self.context.last, self.seen.poses
        if last is None:
            return False
        hidden = [name for name in self.task.object_names if name not in (*seen, self.seen.holding)]
        return any(name not in last or self._rests_on(name, lower, {**last, **seen}) for name in hidden)

    def _rests_on(self, upper: str, lower: str, poses: Mapping[str, RigidTransform]) -> bool:
        """Does `upper` stand over `lower`, close enough to rest on it? What is held rests on nothing."""
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
