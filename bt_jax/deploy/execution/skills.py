"""The actions of a tree on the robot: each a routine that never waits, driven on once a tick.

A routine is a generator that yields while it moves, returns when the action was carried out and raises where it cannot be.
One arm works, the other rests at home. Once the fingers close, or a box is being set down, a routine is committed.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Generator, Iterable

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import Behavior
from bt_jax.deploy.execution.movements import Failed, Moved, Movements, Routine
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.recovery import recovery
from bt_jax.deploy.execution.settings import GraspSettings, MotionSettings
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.link.safety import Rejected
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.grasps import carried_pose, grasp_poses, put_poses, yaw_of
from bt_jax.deploy.planning.paths import Pace
from bt_jax.deploy.planning.planner import Reach, Unplannable
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.robot.arrays import Point
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.encoding.status import Status
from bt_jax.tasks import Task

__all__ = ["RobotSkills"]

Goal = tuple[Point, float]  # where a box's centre should be, base frame [m], and the yaw of its edges [rad]


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
        self.robot, self.task, self.link = robot, task, link
        self.committed, self.reason = False, ""
        self._grasping, self._motion = grasp or GraspSettings(), motion or MotionSettings()
        self._moves = Movements(
            robot,
            task,
            link,
            pace=pace or Pace(),
            grasp=self._grasping,
            motion=self._motion,
            background=background,
        )
        self._routine: Routine | None = None
        # Box -> arm that is not to take it next, if the other can: it failed, or gave it away.
        self._avoid: dict[str, str] = {}

    @property
    def grasped(self) -> dict[str, str]:
        """Arm -> box that it was told to grasp and not to release."""
        return self._moves.grasped

    def start(self, action: Behavior, seen: Observation) -> None:
        """Begin an attempt at an action."""
        self._moves.take(seen)
        match action:
            case Behavior(name="open_gripper"):
                self._begin(self._open_all())
            case Behavior(name="close_gripper"):
                self._begin(self._close_all())
            case Behavior(name="pick", object=str(box)):
                self._begin(self._pick(box))
            case Behavior(name="place", object=str(box), position=(x, y, z), frame=str(frame)):
                self._begin(self._place(box, (x, y, z), frame))
            case _:
                raise ValueError(f"{action} is no action")

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
            self._end()
            return Status.SUCCESS
        except (Failed, Unplannable, Rejected) as failed:
            self.reason = str(failed)
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
        poses = grasp_poses(self._moves.known[name])
        return any(self._moves.planner.can_reach(arm, pose) for arm in self.link.arms for pose in poses)

    def _begin(self, routine: Routine) -> None:
        self.reason, self.committed, self._routine = "", False, routine

    def _end(self) -> None:
        self._routine, self.committed = None, False

    def _halt(self) -> None:
        self._moves.halt()
        self._end()

    def _pick(self, box: str) -> Routine:
        if box not in self._moves.known:
            raise Failed(f"{box} was never seen")
        self._moves.forget_lost()
        yield from self._moves.found(box)
        for _ in range(self._motion.replans):
            reach = yield from self._plan_pick(box)
            self.link.grip(reach.arm, self.robot.arm(reach.arm).gripper.opening, self._grasping.force)
            moved = yield from self._moves.follow(reach.approach, aim=box)
            if moved:
                continue
            yield from self._moves.fingers(reach.arm, at_least=self._moves.sizes[box] + self._grasping.fit)
            moved = yield from self._grasp(box, reach)
            if not moved:
                return
        raise Failed(f"things do not stay where they are on the way to {box}")

    def _plan_pick(self, box: str) -> Generator[None, None, Reach]:
        """Plan for the arm that is mounted nearest to the box, else for another; one that should not take it comes last."""
        last, place = self._avoid.get(box), self._moves.known[box].translation
        away = {arm: np.linalg.norm(place - self.robot.arm(arm).base) for arm in self.link.arms}
        order = sorted(self.link.arms, key=lambda arm: (arm == last, away[arm]))
        problem: Unplannable | None = None
        for arm in order:
            try:
                yield from self._moves.others_home(arm)
                among = self._moves.surroundings()
                return (yield from self._moves.planned(self._moves.planner.pick, box, among, [arm]))
            except Unplannable as error:
                problem = problem or error
        assert problem is not None
        raise problem

    def _grasp(self, box: str, reach: Reach) -> Moved:
        """Go down, close the fingers around it, go up. Return True, above it again, where the box was moved meanwhile.

        Its pose is that of the plan: it was seen before the hand came between it and the camera.
        """
        arm, size, pose = reach.arm, self._moves.sizes[box], reach.approach.among.poses[box]
        moved = yield from self._moves.straight(arm, reach.line, watch={box: pose})
        if moved:
            yield from self._moves.back(arm, reach.line)
            return True
        self.committed = True
        self.link.grip(arm, size - self._grasping.overclose, self._grasping.force)
        tcp = self.robot.forward(arm, self.link.arm(arm).commanded)
        self._moves.carried[arm] = Carried(arm, box, carried_pose(tcp, pose))
        yield from self._moves.fingers(arm)
        failure = self._moves.closed_on(arm, box)
        if failure:
            self._avoid[box] = arm
            self.link.grip(arm, self.robot.arm(arm).gripper.opening, self._grasping.force)
            del self._moves.carried[arm]
            yield from self._moves.fingers(arm)
            yield from self._moves.straight(arm, reach.line[::-1])
            raise Failed(failure)
        yield from self._moves.straight(arm, reach.line[::-1])
        if not self._moves.holds(arm, size):
            self._avoid[box] = arm
            raise Failed(f"{box} slipped out of the {arm} fingers")
        self._avoid.pop(box, None)
        return False

    def _place(self, box: str, position: tuple[float, float, float], frame: str) -> Routine:
        arm = self._arm_with(box)
        if frame != self.task.robot_frame:
            yield from self._moves.found(frame)
        goal, yaw = self._goal(position, frame)
        carried = self._moves.carried[arm].pose
        if not self._reaches(arm, goal, yaw, carried):
            yield from self._hand_over(box, arm, goal, yaw)
            return
        for _ in range(self._motion.replans):
            moved = yield from self._put(arm, lambda: self._goal(position, frame), self._below(frame), frame=frame)
            if not moved:
                return
        raise Failed(f"things do not stay where they are on the way to {frame}")

    def _put(self, arm: str, goal: Callable[[], Goal], supports: Iterable[str], *, frame: str = "") -> Moved:
        """Carry a box to its place in a frame and let it go; return True, with the box still in the hand, where something
        has moved meanwhile."""
        carried = self._moves.carried[arm]
        yield from self._moves.others_home(arm)
        among, (place, yaw) = self._moves.surroundings(), goal()
        above = place + np.array([0, 0, self._grasping.let_go])
        reach = yield from self._moves.planned(self._moves.planner.put, carried, above, yaw, tuple(supports), among)
        moved = yield from self._moves.follow(reach.approach, aim=frame, held=carried.box)
        if moved:
            return True
        aimed = {name: pose for name, pose in among.poses.items() if name == frame}
        moved = yield from self._moves.straight(arm, reach.line, watch=aimed, aim=frame, held=carried.box)
        if moved:
            return True
        self.committed = True
        self.link.grip(arm, self.robot.arm(arm).gripper.opening, self._grasping.force)
        del self._moves.carried[arm]
        self._moves.known[carried.box] = self.robot.forward(arm, self.link.arm(arm).commanded) * carried.pose
        yield from self._moves.fingers(arm, at_least=self._moves.sizes[carried.box] + self._grasping.fit)
        yield from self._moves.straight(arm, reach.line[::-1])
        self.committed = False
        return False

    def _hand_over(self, box: str, arm: str, goal: Point, yaw: float) -> Routine:
        """Set the box down where an arm that reaches its place can pick it, for the tree to have it picked again."""
        held = self._moves.carried[arm].pose
        able = [other for other in self.link.arms if other != arm and self._reaches(other, goal, yaw, held)]
        if not able:
            raise Failed(f"no arm reaches the place for {box}")
        self._avoid[box] = arm
        yield from self._set_down(arm, able[0])

    def _set_down(self, arm: str, other: str | None = None) -> Routine:
        """Put what an arm holds on a free place of a table, one that the `other` reaches too where one is named."""
        carried = self._moves.carried[arm]
        near = self.robot.forward(arm, self.link.arm(arm).commanded).translation
        arms = (arm,) if other is None else (arm, other)
        if (
            other is not None
        ):  # half way: at the edge of its reach an arm has joints for a pose, but no straight way to it
            near = _half_way(near, self.robot.arm(arm).base, self.robot.arm(other).base)
        tables = [table.name for table in self.task.tables]
        tried = 0
        for spot in self._moves.planner.spots(carried.box, self._moves.obstacles(), near):
            if tried == self._motion.spots:
                break
            if all(self._reaches(name, spot, 0.0, carried.pose) for name in arms):
                tried += 1
                with contextlib.suppress(Unplannable):
                    moved = yield from self._put(arm, _fixed_goal(spot), tables)
                    if not moved:
                        return
            yield
        raise Failed(f"there is no free place to set {carried.box} down")

    def _open_all(self) -> Routine:
        for arm in list(self._moves.carried):
            if self._moves.seen.holding == self._moves.carried[arm].box:
                yield from self._set_down(arm)
            else:
                del self._moves.carried[arm]
        for arm in self.link.arms:
            self.link.grip(arm, self.robot.arm(arm).gripper.opening, self._grasping.force)
        for arm in self.link.arms:
            yield from self._moves.fingers(arm, at_least=0.95 * self.robot.arm(arm).gripper.opening)

    def _close_all(self) -> Routine:
        self.committed = True
        for arm in self.link.arms:
            self.link.grip(arm, 0.0, self._grasping.force)
        for arm in self.link.arms:
            yield from self._moves.fingers(arm)

    def _arm_with(self, box: str) -> str:
        for arm, carried in self._moves.carried.items():
            if carried.box == box:
                return arm
        raise Failed(f"no hand holds {box}")

    def _goal(self, position: tuple[float, float, float], frame: str) -> Goal:
        """Return where the box's centre should be in the base frame, and along which direction its edges."""
        if frame == self.task.robot_frame:
            return np.array(position), 0.0
        pose = self._moves.known[frame]
        return pose.apply(position), yaw_of(pose.rotation)

    def _reaches(self, arm: str, goal: Point, yaw: float, held: RigidTransform) -> bool:
        """Can an arm put a box that is at `held` in its TCP's frame there?"""
        return any(self._moves.planner.can_reach(arm, pose) for pose in put_poses(goal, yaw, held))

    def _below(self, frame: str) -> list[str]:
        """Return what a box that is set down may touch: what it is placed in relation to, the kit and the tables."""
        return [frame, self.task.kit.name, *(table.name for table in self.task.tables)]


def _half_way(point: Point, first: Point, second: Point) -> Point:
    """Return the point that is nearest to one, of those as far from `first` as from `second`."""
    across = (second - first) / np.linalg.norm(second - first)
    return point - across * np.dot(across, point - (first + second) / 2)


def _fixed_goal(spot: Point) -> Callable[[], Goal]:
    """Return a goal that does not move."""
    return lambda: (spot, 0.0)
