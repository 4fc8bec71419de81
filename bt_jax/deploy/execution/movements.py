"""What the robot's actions are made of: ways that are planned, followed and watched, and fingers that close or open.

Each is a routine: a generator that yields while it moves, returns when it was carried out and raises where it cannot be.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterable, Mapping
from concurrent.futures.process import BrokenProcessPool
from types import MappingProxyType
from typing import TypeVar

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.observation import Observation
from bt_jax.deploy.execution.settings import GraspSettings, MotionSettings
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.grasps import grip_width, release_width
from bt_jax.deploy.planning.planner import JointPath, Planner, Surroundings
from bt_jax.deploy.planning.pose_geometry import distance_between, turn_between
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.planning.timing import Pace, timed
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.arrays import JointRows, Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["Failed", "Moved", "Movements", "Poses", "Routine"]

Routine = Generator[None, None, None]
Moved = Generator[None, None, bool]
Result = TypeVar("Result")
Poses = Mapping[str, RigidTransform]
NOWHERE: Poses = MappingProxyType({})


class Failed(Exception):
    """The attempt is over; the message says why. `fault` is the name in `tasks.faults.FAULTS` of what went wrong, "" for
    anything else."""

    def __init__(self, message: str, fault: str = "") -> None:
        super().__init__(message)
        self.fault = fault


class Movements:
    """The arms of one cell, and what they move among: `seen` now, `known` as it was seen last, and `carried` by an arm. With
    `background`, plans are made there while ticks go on; else a tick waits for its plan."""

    def __init__(
        self,
        robot: RobotModel,
        task: Task,
        link: RobotLink,
        *,
        pace: Pace,
        grasp: GraspSettings,
        motion: MotionSettings,
        background: PlanningProcess | None,
    ) -> None:
        self.robot, self.link, self.planner = robot, link, Planner(robot, task)
        self.things = {thing.name: thing for thing in task.objects}
        self.seen = Observation(-math.inf, {}, {}, None)  # nothing, yet
        self.known: dict[str, RigidTransform] = {}
        self.carried: dict[str, Carried] = {}
        self.grasp, self.motion = grasp, motion
        self._pace, self._background = pace, background

    @property
    def grasped(self) -> dict[str, str]:
        """Arm -> box that it was told to grasp and not to release."""
        return {arm: carried.box for arm, carried in self.carried.items() if carried.known}

    def take(self, seen: Observation) -> None:
        """Take note of what is seen now."""
        self.seen = seen
        self.known.update(seen.poses)

    def halt(self) -> None:
        """Bring the arms to rest on their paths."""
        for arm in self.link.arms:
            if self.link.stopped() is None and self.link.arm(arm).moving:
                self.link.halt(arm)

    def planned(self, plan: Callable[..., Result], *arguments: object) -> Generator[None, None, Result]:
        """Return what a method of the planner returns. Raise what it raises."""
        if self._background is None:
            return plan(*arguments)
        try:
            future = self._background.submit(plan.__name__, *arguments)
            try:
                while not future.done():
                    yield
                return future.result()
            finally:
                future.cancel()
        except BrokenProcessPool as error:
            raise UserError("the process that plans has ended; start the run again") from error

    def go_home(self, arms: Iterable[str]) -> Routine:
        for arm in arms:
            plans = 0
            while not np.abs(self.joints()[arm] - self.robot.home[arm]).max() <= self.motion.at_home:
                if plans == self.motion.replans:
                    raise Failed(f"things do not stay where they are on the {arm} arm's way home")
                path = yield from self.planned(self.planner.home, arm, self.all_around())
                yield from self.follow(path)
                plans += 1

    def others_home(self, arm: str) -> Routine:
        yield from self.go_home([other for other in self.link.arms if other != arm])

    def follow(self, path: JointPath, *, aim: str = "", held: str | None = None) -> Moved:
        """Move freely along a path. Return True, at rest on it, if something that it was planned among, above all what it
        aims at, is seen to have left its pose.

        Raise Failed if what is held is lost, or the arm is halted by something else.
        """
        trajectory = yield from self.planned(self.planner.timed, path, self._pace)
        return (yield from self._move(path.arm, trajectory, path.among.poses, aim, held))

    def straight(
        self, arm: str, line: JointRows, *, watch: Poses = NOWHERE, aim: str = "", held: str | None = None
    ) -> Moved:
        """Move in the same way, slowly, along a straight line of the tool."""
        trajectory = timed(line, self._pace.slowed(self.motion.straight), self.robot.arm(arm))
        return (yield from self._move(arm, trajectory, watch, aim, held))

    def back(self, arm: str, line: JointRows) -> Routine:
        """Move to the top of a straight line down, from wherever on it the arm was halted."""
        here = self.link.arm(arm).commanded
        above = [row for row in line[::-1] if self._height(arm, row) > self._height(arm, here)]
        if above:
            yield from self.straight(arm, np.array([here, *above]))

    def _move(self, arm: str, trajectory: Trajectory, watch: Poses, aim: str, held: str | None) -> Moved:
        if self._shifted(watch, aim):
            return True
        motion = self.link.follow(arm, trajectory)
        yield
        while (state := self.link.arm(arm)).moving or state.motion != motion:
            lost = "" if held is None else self._lost(arm, held)
            if lost:
                raise Failed(lost, "drop")
            if self._shifted(watch, aim):
                self.link.halt(arm)
                while self.link.arm(arm).moving:
                    yield
                return True
            yield
        if not np.abs(state.commanded - trajectory.joints[-1]).max() <= self.motion.arrived:
            raise Failed(f"the {arm} arm was halted on its way")
        yield from self._settled(arm, trajectory.joints[-1])
        return False

    def _settled(self, arm: str, end: Joints) -> Routine:
        """Wait until an arm is measured where its path ends: it follows its setpoints late.

        Raise Failed if it does not come there.
        """
        began = self.link.now()
        while not (off := float(np.abs(self.link.arm(arm).joints - end).max())) <= self.motion.arrived:
            if not self.link.now() - began <= self.motion.settle:
                raise Failed(
                    f"the {arm} arm rests {np.degrees(off):.1f} deg from the end of its path; something holds it"
                )
            yield

    def fingers(self, arm: str, *, at_least: float | None = None) -> Routine:
        """Wait until the fingers, told to move just now, are as far apart, or have moved and rest. A reading may be older
        than the command: fingers that do not seem to move are waited for, as long as a command may take to show.

        Raise Failed if that takes too long.
        """
        began, first = self.link.now(), self.link.arm(arm).opening
        moved, last, since = False, first, began  # `since`: when the reading was another one
        while True:
            yield
            now, opening = self.link.now(), self.link.arm(arm).opening
            if not abs(opening - last) < self.grasp.still:
                moved, last, since = True, opening, now
            patience = self.grasp.rest if moved else self.grasp.reaction
            if at_least is None and now - since >= patience:
                return
            if at_least is not None and opening >= at_least:
                return
            if not now - began <= self.grasp.patience:
                raise Failed(f"the {arm} fingers do not move as they should; calibrate the gripper", "jam")

    def found(self, *names: str, patience: float | None = None) -> Routine:
        """Wait until one of some things is seen, with the arms out of the camera's way if none is.

        Raise Failed if none is seen within `patience` [s], by default that of an attempt that needs it.
        """
        if any(map(self._is_seen, names)):
            return
        yield from self.go_home(self.link.arms)
        end = self.link.now() + (self.motion.sight if patience is None else patience)
        while not any(map(self._is_seen, names)):
            if not self.link.now() <= end:
                raise Failed(f"{' or '.join(names)} is not seen")
            yield

    def holds(self, arm: str, size: float) -> bool:
        """Are an arm's closing fingers as far apart as something of this width would hold them?"""
        state = self.link.arm(arm)
        return state.grip_target < size and abs(state.opening - size) <= self.grasp.fit

    def width(self, carried: Carried) -> float:
        """Return how far apart the fingers are that hold an object as it is carried, m."""
        return grip_width(self.things[carried.box], carried.pose)

    def grip(self, carried: Carried) -> None:
        """Begin to close the fingers around an object."""
        self.link.grip(carried.arm, self.width(carried) - self.grasp.overclose, self.grasp.force)

    def release(self, carried: Carried) -> None:
        """Begin to open the fingers that hold an object, no wider than its neighbours allow."""
        opening = self.robot.arm(carried.arm).gripper.opening
        wide = release_width(self.things[carried.box], carried.pose, opening)
        self.link.grip(carried.arm, wide, self.grasp.force)

    def around(self, arm: str, width: float) -> float:
        """Return how far apart fingers must be to pass over something of this width, m."""
        return min(width + self.grasp.fit, self.robot.arm(arm).gripper.opening - self.grasp.nothing)

    def closed_on(self, arm: str, carried: Carried) -> Failed | None:
        """Return what fingers that rest have closed on if it is not what they were to grasp; else None."""
        state, box = self.link.arm(arm), carried.box
        if self.holds(arm, self.width(carried)):
            return None
        ends = (0.0, state.grip_target)  # some grippers close as far as they can
        if any(abs(state.opening - end) <= self.grasp.nothing for end in ends):
            return Failed(f"the {arm} fingers closed on nothing", "slip")
        wide = f"{1000 * state.opening:.0f} mm"
        if state.opening >= self.robot.arm(arm).gripper.opening - self.grasp.nothing:
            return Failed(f"the {arm} fingers did not close: they are still {wide} apart; look at the gripper", "jam")
        return Failed(
            f"the {arm} fingers closed on something {wide} wide that is not {box}: something unknown is there"
        )

    def forget_lost(self) -> None:
        """Keep, of what was grasped, what is held or still between the fingers by their readings."""
        self.carried = {
            arm: carried
            for arm, carried in self.carried.items()
            if carried.box == self.seen.holding or self.holds(arm, self.width(carried))
        }

    def surroundings(self, arm: str = "") -> Surroundings:
        """Return what a motion is planned among now, with nothing carried but what `arm` does."""
        return Surroundings(self.obstacles(), self.joints(), self.carried.get(arm))

    def all_around(self) -> Surroundings:
        """Return what a motion of any arm is planned among now, with what one of them carries."""
        return Surroundings(self.obstacles(), self.joints(), next(iter(self.carried.values()), None))

    def joints(self) -> dict[str, Joints]:
        """Return the last setpoints of each arm."""
        return {arm: self.link.arm(arm).commanded for arm in self.link.arms}

    def obstacles(self) -> dict[str, RigidTransform]:
        """Return what is known of the cell, without what is in a hand."""
        held = set(self.grasped.values())
        return {name: pose for name, pose in self.known.items() if name not in held}

    def _lost(self, arm: str, box: str) -> str:
        """Return why a box that an arm carries is no longer in its fingers, "" if it is."""
        if not self.link.arm(arm).opening >= self.width(self.carried[arm]) - self.grasp.fit:
            return f"{box} slipped out of the {arm} fingers on the way"
        if self.seen.holding == box:
            return ""
        if box in self.seen.poses:
            return f"{box} is seen elsewhere, and something unknown is between the {arm} fingers"
        return f"{box} was lost on the way"

    def _shifted(self, watch: Poses, aim: str) -> bool:
        """Is something seen that has left its pose, or has turned, or is what is aimed at missing?"""
        seen = self.seen.poses
        return aim in self.seen.missing or any(
            not distance_between(pose, seen[name]) <= (self.motion.shifted if name == aim else self.motion.aside)
            or not turn_between(pose, seen[name]) <= self.motion.turned
            for name, pose in watch.items()
            if name in seen
        )

    def _is_seen(self, name: str) -> bool:
        return name in self.seen.poses and name not in self.seen.missing

    def _height(self, arm: str, joints: Joints) -> float:
        """Return the height of the tool over the base, m."""
        return float(self.robot.forward(arm, joints).translation[2])
