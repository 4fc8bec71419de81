"""The actions of a tree on the robot: each a routine that never waits, driven on once a tick.

A routine is a generator that yields while it moves, returns when the action was carried out and raises where it cannot be.
One arm works, the other rests at home. Once the fingers close, or a box is being set down, a routine is committed.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterable
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import Behavior
from bt_jax.deploy import yumi
from bt_jax.deploy.clearance import Carried
from bt_jax.deploy.grasps import carried_pose, grasp_poses, put_poses, yaw_of
from bt_jax.deploy.link import RobotLink
from bt_jax.deploy.observation import Observation
from bt_jax.deploy.observer import SQUEEZE
from bt_jax.deploy.paths import Pace
from bt_jax.deploy.planning import Planner, Reach, Unplannable
from bt_jax.deploy.planning_process import PlanningProcess
from bt_jax.deploy.safety import Rejected
from bt_jax.encoding.status import Status
from bt_jax.task import Task

__all__ = ["YumiSkills"]

GRIP = 4 * SQUEEZE  # metres by which a grasp would close further than the box is wide
FORCE = 15.0  # N
PATIENCE = 4.0  # seconds for fingers to come to rest
STILL = 0.0005  # metres that resting fingers move from tick to tick
AT_HOME = 0.05  # rad
SHIFTED = 0.006  # metres by which a box must have moved for a plan to be made anew
REPLANS = 3
SLOW = 0.3  # of the pace, straight down
LET_GO = 0.0007  # metres above its place at which a box is let go
SPOTS = 25  # places tried for setting a box down

Routine = Generator[None, None, None]
Result = TypeVar("Result")


class _Failed(Exception):
    """The attempt is over; the message says why."""


class YumiSkills:
    """Skills for one cell. `pace` is that of free motion. With `background`, plans are made there while ticks go on; else a
    tick waits for its plan."""

    def __init__(
        self, task: Task, link: RobotLink, *, pace: Pace | None = None, background: PlanningProcess | None = None
    ) -> None:
        self.task, self.link, self.pace = task, link, pace or Pace()
        self.committed, self.reason = False, ""
        self._planner, self._background = Planner(task), background
        self._sizes = {box.name: box.size for box in task.boxes}
        self._routine: Routine | None = None
        self._seen: Observation | None = None
        self._known: dict[str, RigidTransform] = {}  # where things were seen last
        self._carried: dict[str, Carried] = {}
        self._avoid: dict[
            str, str
        ] = {}  # box -> arm that is not to take it next, if the other can: it failed, or gave it away

    @property
    def grasped(self) -> dict[str, str]:
        """Arm -> box that it was told to grasp and not to release."""
        return {arm: carried.box for arm, carried in self._carried.items()}

    def start(self, action: Behavior, seen: Observation) -> None:
        """Begins an attempt at an action."""
        self._take(seen)
        routines = {
            "open_gripper": self._open_all,
            "close_gripper": self._close_all,
            "pick": lambda: self._pick(action.object, yumi.ARMS),
            "place": lambda: self._place(action.object, action.position, action.frame),
        }
        self._begin(routines[action.name]())

    def look(self) -> None:
        """Begins to take both arms home."""
        self._begin(self._go_home(yumi.ARMS))

    def poll(self, seen: Observation) -> Status:
        """Drives on what was begun."""
        self._take(seen)
        if self._routine is None:
            return Status.FAILURE
        try:
            next(self._routine)
            return Status.RUNNING
        except StopIteration:
            self._end()
            return Status.SUCCESS
        except (_Failed, Unplannable, Rejected) as failed:
            self.reason = str(failed)
            self._halt()
            return Status.FAILURE

    def cancel(self) -> None:
        """Brings the arms to rest on their paths."""
        self._halt()

    def reachable(self, name: str, seen: Observation) -> bool:
        """Does an arm have joints for a grasp of a box where it is seen?"""
        self._take(seen)
        if name not in self._known:
            return False
        poses = grasp_poses(self._known[name])
        return any(self._planner.can_reach(arm, pose) for arm in yumi.ARMS for pose in poses)

    def _begin(self, routine: Routine) -> None:
        self.reason, self.committed, self._routine = "", False, routine

    def _end(self) -> None:
        self._routine, self.committed = None, False

    def _halt(self) -> None:
        for arm in self.link.arms:
            if self.link.stopped() is None and self.link.arm(arm).moving:
                self.link.halt(arm)
        self._end()

    def _take(self, seen: Observation) -> None:
        self._seen = seen
        self._known.update(seen.poses)

    def _planned(self, plan: Callable[..., Result], *arguments: object) -> Generator[None, None, Result]:
        """What a method of the planner gives. Raises what it raises."""
        if self._background is None:
            return plan(*arguments)
        future = self._background.submit(plan.__name__, *arguments)
        while not future.done():
            yield
        return future.result()

    def _joints(self) -> dict[str, np.ndarray]:
        return {arm: self.link.arm(arm).commanded for arm in self.link.arms}

    def _obstacles(self) -> dict[str, RigidTransform]:
        """What is known of the cell, without what is in a hand."""
        held = set(self.grasped.values())
        return {name: pose for name, pose in self._known.items() if name not in held}

    def _pick(self, box: str, arms: Iterable[str]) -> Routine:
        if box not in self._known:
            raise _Failed(f"{box} was never seen")
        self._carried = {
            arm: held for arm, held in self._carried.items() if held.box == self._seen.holding
        }  # not what fell
        if box not in self._seen.poses:
            yield from self._go_home(yumi.ARMS)
            yield from self._until_seen(box)
        for _ in range(REPLANS):
            start = self._known[box]
            reach = yield from self._plan_pick(box, arms)
            if reach is None:
                continue
            yield from self._others_home(reach.arm)
            self.link.grip(reach.arm, yumi.OPENING, FORCE)
            moved = yield from self._follow(reach.arm, reach.approach, 1.0, watch=(box, start))
            if not moved:
                yield from self._fingers(reach.arm, at_least=self._sizes[box] + 0.006)
                yield from self._grasp(box, reach, start)
                return
        raise _Failed(f"{box} does not stay where it is")

    def _plan_pick(self, box: str, arms: Iterable[str]) -> Generator[None, None, Reach | None]:
        """The arm that reaches best from where it is; one that should not comes last."""
        last = self._avoid.get(box)
        side = "left" if self._known[box].translation[1] > 0 else "right"
        order = sorted(arms, key=lambda arm: (arm == last, arm != side))
        problem: Unplannable | None = None
        for arm in order:
            yield from self._others_home(arm)
            try:
                return (yield from self._planned(self._planner.pick, box, self._obstacles(), self._joints(), [arm]))
            except Unplannable as error:
                problem = problem or error
        assert problem is not None
        raise problem

    def _grasp(self, box: str, reach: Reach, pose: RigidTransform) -> Routine:
        """Down, fingers around it, up. `pose` is the box's as it was seen before the hand came between it and the camera."""
        arm, size = reach.arm, self._sizes[box]
        yield from self._follow(arm, reach.line, SLOW)
        self.committed = True
        self.link.grip(arm, size - GRIP, FORCE)
        tcp = yumi.forward(arm, self.link.arm(arm).commanded)
        self._carried[arm] = Carried(arm, box, carried_pose(tcp, pose))
        yield from self._fingers(arm)
        if self.link.arm(arm).opening < size - SQUEEZE:
            self._avoid[box] = arm
            self.link.grip(arm, yumi.OPENING, FORCE)
            del self._carried[arm]
            yield from self._fingers(arm)
            yield from self._follow(arm, reach.line[::-1], SLOW)
            raise _Failed(f"the {arm} fingers closed on nothing")
        yield from self._follow(arm, reach.line[::-1], SLOW)
        if self.link.arm(arm).opening < size - SQUEEZE:
            self._avoid[box] = arm
            raise _Failed(f"{box} slipped out of the {arm} fingers")
        self._avoid.pop(box, None)

    def _place(self, box: str, position: tuple[float, float, float], frame: str) -> Routine:
        arm = self._arm_with(box)
        goal, yaw = self._goal(position, frame)
        if not self._reaches(arm, goal, yaw):
            yield from self._hand_over(box, arm, goal)
            return
        for _ in range(REPLANS):
            goal, yaw = self._goal(position, frame)
            moved = yield from self._put(arm, goal, yaw, self._below(goal, frame), watch=frame)
            if not moved:
                return
        raise _Failed(f"{frame} does not stay where it is")

    def _put(self, arm: str, goal: np.ndarray, yaw: float, supports: Iterable[str], *, watch: str | None) -> Routine:
        """Carries a box to its place and lets it go; gives True, with the box still in the hand, where what is watched has
        moved meanwhile."""
        carried = self._carried[arm]
        yield from self._others_home(arm)
        start = self._known.get(watch) if watch is not None else None
        above = goal + np.array([0, 0, LET_GO])
        reach = yield from self._planned(
            self._planner.put, carried, above, yaw, tuple(supports), self._obstacles(), self._joints()
        )
        watched = None if start is None else (watch, start)
        moved = yield from self._follow(arm, reach.approach, 1.0, watch=watched, held=carried.box)
        if moved:
            return True
        yield from self._follow(arm, reach.line, SLOW, held=carried.box)
        self.committed = True
        self.link.grip(arm, yumi.OPENING, FORCE)
        del self._carried[arm]
        self._known[carried.box] = yumi.forward(arm, self.link.arm(arm).commanded) * carried.pose
        yield from self._fingers(arm, at_least=self._sizes[carried.box] + 0.006)
        yield from self._follow(arm, reach.line[::-1], SLOW)
        self.committed = False
        return False

    def _hand_over(self, box: str, arm: str, goal: np.ndarray) -> Routine:
        """Sets the box down where both arms reach it, for the tree to have it picked again: by the other one then."""
        other = next(name for name in yumi.ARMS if name != arm)
        if not self._reaches(other, goal, 0.0):
            raise _Failed(f"neither arm reaches the place for {box}")
        self._avoid[box] = arm
        yield from self._set_down(arm, both=True)

    def _set_down(self, arm: str, *, both: bool = False) -> Routine:
        """Puts what an arm holds on a free place of a table, one that both arms reach where asked for."""
        carried = self._carried[arm]
        near = yumi.forward(arm, self.link.arm(arm).commanded).translation
        arms = yumi.ARMS if both else (arm,)
        tables = [table.name for table in self.task.tables]
        for count, spot in enumerate(self._planner.spots(carried.box, self._obstacles(), near)):
            if count == SPOTS:
                break
            if all(self._reaches(name, spot, 0.0) for name in arms):
                try:
                    yield from self._put(arm, spot, 0.0, tables, watch=None)
                    return
                except Unplannable:
                    continue
        raise _Failed(f"there is no free place to set {carried.box} down")

    def _open_all(self) -> Routine:
        for arm in list(self._carried):
            if self._seen.holding == self._carried[arm].box:
                yield from self._set_down(arm)
            else:
                del self._carried[arm]
        for arm in self.link.arms:
            self.link.grip(arm, yumi.OPENING, FORCE)
        for arm in self.link.arms:
            yield from self._fingers(arm, at_least=0.95 * yumi.OPENING)

    def _close_all(self) -> Routine:
        self.committed = True
        for arm in self.link.arms:
            self.link.grip(arm, 0.0, FORCE)
        for arm in self.link.arms:
            yield from self._fingers(arm)

    def _go_home(self, arms: Iterable[str]) -> Routine:
        for arm in arms:
            joints = self._joints()
            if np.abs(joints[arm] - yumi.HOME[arm]).max() > AT_HOME:
                path = yield from self._planned(
                    self._planner.home, arm, self._obstacles(), joints, self._carried.get(arm)
                )
                yield from self._follow(arm, path, 1.0)

    def _others_home(self, arm: str) -> Routine:
        yield from self._go_home([other for other in self.link.arms if other != arm])

    def _follow(
        self,
        arm: str,
        path: np.ndarray,
        pace: float,
        *,
        watch: tuple[str, RigidTransform] | None = None,
        held: str | None = None,
    ) -> Generator[None, None, bool]:
        """Moves along a path; True, at rest on it, where the watched thing is seen to have left its pose. Raises where what
        is held is lost."""
        trajectory = yield from self._planned(self._planner.timed, arm, path, self.pace.slowed(pace), self._joints())
        motion = self.link.follow(arm, trajectory)
        yield
        while (state := self.link.arm(arm)).moving or state.motion != motion:
            if held is not None and self._dropped(arm, held):
                raise _Failed(f"{held} was lost on the way")
            if watch is not None and self._shifted(*watch):
                self.link.halt(arm)
                while self.link.arm(arm).moving:
                    yield
                return True
            yield
        return False

    def _fingers(self, arm: str, *, at_least: float | None = None) -> Routine:
        """Until the fingers are as far apart, or rest. Raises where that takes too long."""
        end, before = self.link.now() + PATIENCE, np.inf
        while True:
            yield
            opening = self.link.arm(arm).opening
            if opening >= at_least if at_least is not None else abs(opening - before) < STILL:
                return
            before = opening
            if self.link.now() > end:
                raise _Failed(f"the {arm} fingers do not move as they should")

    def _until_seen(self, name: str) -> Routine:
        end = self.link.now() + PATIENCE
        while name not in self._seen.poses:
            if self.link.now() > end:
                raise _Failed(f"{name} is not seen")
            yield

    def _dropped(self, arm: str, box: str) -> bool:
        return self.link.arm(arm).opening < self._sizes[box] - 2 * SQUEEZE or self._seen.holding != box

    def _shifted(self, name: str, start: RigidTransform) -> bool:
        pose = self._seen.poses.get(name)
        return pose is not None and float(np.linalg.norm(pose.translation - start.translation)) > SHIFTED

    def _arm_with(self, box: str) -> str:
        for arm, carried in self._carried.items():
            if carried.box == box:
                return arm
        raise _Failed(f"no hand holds {box}")

    def _goal(self, position: tuple[float, float, float], frame: str) -> tuple[np.ndarray, float]:
        """Where the box's centre should be in the base frame, and along which direction its edges."""
        if frame == self.task.robot_frame:
            return np.array(position), 0.0
        if frame not in self._known:
            raise _Failed(f"{frame} was never seen")
        pose = self._known[frame]
        return pose.apply(position), yaw_of(pose.rotation)

    def _reaches(self, arm: str, goal: np.ndarray, yaw: float) -> bool:
        held = next(iter(self._carried.values())).pose if self._carried else RigidTransform.identity()
        return any(self._planner.can_reach(arm, pose) for pose in put_poses(goal, yaw, held))

    def _below(self, goal: np.ndarray, frame: str) -> list[str]:
        """What a box that is set down may touch: what it is placed in relation to, the kit and the tables."""
        return [frame, self.task.kit.name, *(table.name for table in self.task.tables)]
