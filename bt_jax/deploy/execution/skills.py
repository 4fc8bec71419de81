"""The actions of a tree on the robot: each a routine of `handling` that never waits, driven on once a tick."""

from __future__ import annotations

import math
from collections import Counter

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.handling import Handling, Place
from bt_jax.deploy.execution.movements import Failed, Movements, Routine
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.recovery import recovery
from bt_jax.deploy.execution.settings import SIMULATED_TICK, GraspSettings, MotionSettings
from bt_jax.deploy.execution.statuses import Context, Statuses
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.link.safety import Rejected
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.planning.timing import Pace
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["RobotSkills"]


class RobotSkills:
    """Skills of a robot in one cell. `pace` is that of free motion. With `background`, plans are made there while ticks go
    on; else a tick waits for its plan."""

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        link: RobotLink,
        *,
        pace: Pace | None = None,
        grasp: GraspSettings | None = None,
        motion: MotionSettings | None = None,
        background: PlanningProcess | None = None,
    ) -> None:
        self.link, self.reason, self.fault = link, "", ""
        self._moves = Movements(
            robot,
            task,
            link,
            pace=pace or Pace(),
            grasp=grasp or GraspSettings(),
            motion=motion or MotionSettings(),
            background=background,
        )
        self._handling = Handling(task, self._moves)
        self._task, self._tried = task, Counter[str]()
        self._routine: Routine | None = None

    @property
    def committed(self) -> bool:
        """Is it in a phase that must not be broken off?"""
        return self._handling.committed

    @property
    def grasped(self) -> dict[str, str]:
        """Arm -> box that it was told to grasp and not to release."""
        return self._moves.grasped

    def start(self, action: Behavior, seen: Observation) -> None:
        """Begin an attempt at an action."""
        self._moves.take(seen)
        match action:
            case Behavior(name="open_gripper"):
                self._begin(self._handling.open_all())
            case Behavior(name="close_gripper"):
                self._begin(self._handling.close_all())
            case Behavior(name="pick", object=str(name)):
                self._begin(self._handling.pick(self._chosen(name)))
            case Behavior(name="place", object=str(box), position=(x, y, z), frame=str(frame), turn=turn):
                self._begin(self._handling.place(box, Place((x, y, z), frame, turn)))
            case Behavior(name="look", object=str(name)):
                patience = SIMULATED_TICK * self._task.episode.action_ticks
                self._begin(self._moves.found(*self._task.instances[name], patience=patience))
            case _:
                raise ValueError(f"{action} is no action")

    def _chosen(self, name: str) -> str:
        """Return the object to pick up: of a part, the nearest instance that can be taken, of those tried least
        since one was picked."""
        if name in self._task.object_names:
            return name
        seen = self._moves.seen
        found = [one for one in Statuses(self._task, seen, Context()).candidates(name) if self.reachable(one, seen)]
        found.sort(key=lambda one: self._tried[one])
        chosen = next(iter(found), self._task.instances[name][0])
        self._tried[chosen] += 1
        return chosen

    def look(self) -> None:
        """Begin to take the arms home."""
        if math.isfinite(self._moves.seen.time):
            self._moves.forget_lost()
        self._begin(self._moves.go_home(self.link.arms))

    def recover(self, *, keep: bool) -> None:
        """Begin to take the arms home from where a stop has left them, without what they hold, or with it."""
        self._begin(recovery(self._moves, keep=keep))

    def poll(self, seen: Observation) -> Status:
        """Continue what was begun."""
        self._moves.take(seen)
        if self._routine is None:
            return Status.FAILURE
        try:
            next(self._routine)
            return Status.RUNNING
        except StopIteration:
            for one in self.grasped.values():
                del self._tried[one]
            self._end()
            return Status.SUCCESS
        except (Failed, Unplannable, Rejected) as failed:
            self.reason, self.fault = str(failed), failed.fault if isinstance(failed, Failed) else ""
            self._halt()
            return Status.FAILURE

    def cancel(self) -> None:
        """Bring the arms to rest on their paths."""
        self._halt()

    def reachable(self, name: str, seen: Observation) -> bool:
        """Does an arm have joints for a grasp of a box at the pose that is seen?"""
        self._moves.take(seen)
        if name not in self._moves.known:
            return False
        planner, pose = self._moves.planner, self._moves.known[name]
        return any(planner.can_reach(arm, tcp) for arm in self.link.arms for tcp in planner.grasps(arm, name, pose))

    def _begin(self, routine: Routine) -> None:
        self.reason, self.fault, self._handling.committed, self._routine = "", "", False, routine

    def _end(self) -> None:
        self._routine, self._handling.committed = None, False

    def _halt(self) -> None:
        self._moves.halt()
        self._end()
