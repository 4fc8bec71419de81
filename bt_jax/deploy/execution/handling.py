"""What the hands do with boxes: pick one up, put it where it should be, set it down, open and close all fingers.

Each is a routine, a generator that yields while it moves, returns when it was carried out and raises where it cannot be. One
arm works, the others rest at home. Once the fingers close, or a box is being set down, a routine is committed.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Generator

import numpy as np

from bt_jax.deploy.execution.movements import Failed, Moved, Movements, Routine
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.grasps import carried_pose, put_poses, yaw_of
from bt_jax.deploy.planning.planner import Reach
from bt_jax.deploy.planning.pose_geometry import heading
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.arrays import Point
from bt_jax.tasks import Task

__all__ = ["Handling", "Place"]

Goal = tuple[Point, float, float | None]
"""Where an object's centre should be [m] and the yaw of the frame's axes [rad], in the base frame, and how it should be
turned in it [degrees]; None where it need not be."""


@dataclasses.dataclass(frozen=True)
class Place:
    """Where an object should be: a position in a frame [m], and its turn in it [degrees] where that counts."""

    position: tuple[float, float, float]
    frame: str
    turn: float | None = None


class Handling:
    """The routines of one cell. `committed` says that the one under way must not be broken off."""

    def __init__(self, task: Task, moves: Movements) -> None:
        self.task, self.moves, self.committed = task, moves, False
        # Box -> arm that is not to take it next, if another can: it failed, or gave it away.
        self._avoid: dict[str, str] = {}

    def pick(self, box: str) -> Routine:
        """Pick a box up, with the arm that is mounted nearest to it if that has a way."""
        if box not in self.moves.known:
            raise Failed(f"{box} was never seen")
        self.moves.forget_lost()
        for _ in range(self.moves.motion.replans):
            yield from self.moves.found(box)
            reach = yield from self._plan_pick(box)
            self._open(reach.arm)
            moved = yield from self.moves.follow(reach.approach, aim=box)
            if moved:
                continue
            held = Carried(reach.arm, box, reach.tcp.inv() * reach.approach.among.poses[box])
            over = self.moves.around(reach.arm, self.moves.width(held))
            yield from self.moves.fingers(reach.arm, at_least=over)
            moved = yield from self._grasp(box, reach)
            if not moved:
                return
        raise Failed(f"things do not stay where they are on the way to {box}")

    def _plan_pick(self, box: str) -> Generator[None, None, Reach]:
        """Plan for the arm that is mounted nearest to the box, else for another; one that should not take it comes last."""
        last, place = self._avoid.get(box), self.moves.known[box].translation
        away = {arm: np.linalg.norm(place - self.moves.robot.arm(arm).base) for arm in self.moves.link.arms}
        order = sorted(self.moves.link.arms, key=lambda arm: (arm == last, away[arm]))
        problem: Unplannable | None = None
        for arm in order:
            try:
                yield from self.moves.others_home(arm)
                among = self.moves.surroundings()
                return (yield from self.moves.planned(self.moves.planner.pick, box, among, [arm]))
            except Unplannable as error:
                problem = problem or error
        assert problem is not None
        raise problem

    def _grasp(self, box: str, reach: Reach) -> Moved:
        """Go down, close the fingers around it, go up. Return True, above it again, where the box was moved meanwhile.

        Its pose is that of the plan: it was seen before the hand came between it and the camera.
        """
        arm, pose = reach.arm, reach.approach.among.poses[box]
        moved = yield from self.moves.straight(arm, reach.line, watch={box: pose})
        if moved:
            yield from self.moves.back(arm, reach.line)
            return True
        self.committed = True
        tcp = self.moves.robot.forward(arm, self.moves.link.arm(arm).commanded)
        carried = Carried(arm, box, carried_pose(tcp, pose, self.task.thing(box)))
        self.moves.grip(carried)
        self.moves.carried[arm] = carried
        yield from self.moves.fingers(arm)
        failure = self.moves.closed_on(arm, carried)
        if failure:
            self._avoid[box] = arm
            self._open(arm)
            del self.moves.carried[arm]
            yield from self.moves.fingers(arm)
            yield from self.moves.straight(arm, reach.line[::-1])
            raise failure
        yield from self.moves.straight(arm, reach.line[::-1])
        if not self.moves.holds(arm, self.moves.width(carried)):
            self._avoid[box] = arm
            raise Failed(f"{box} slipped out of the {arm} fingers", "slip")
        self._avoid.pop(box, None)
        return False

    def place(self, box: str, place: Place) -> Routine:
        """Put what is held, a box or an instance of a part, at a place, or where another arm can take it that reaches
        there."""
        arm, frame = self._arm_with(box), place.frame
        carried = self.moves.carried[arm]
        yield from self._found(frame)
        goal = self._goal(carried.box, place)
        if not self._reaches(arm, goal, carried):
            yield from self._hand_over(carried.box, arm, goal)
            return
        for _ in range(self.moves.motion.replans):
            yield from self._found(frame)
            moved = yield from self._put(arm, lambda: self._goal(carried.box, place), frame=frame)
            if not moved:
                return
        raise Failed(f"things do not stay where they are on the way to {frame}")

    def _found(self, frame: str) -> Routine:
        if frame != self.task.robot_frame:
            yield from self.moves.found(frame)

    def _put(self, arm: str, goal: Callable[[], Goal], *, frame: str = "") -> Moved:
        """Carry a box to its place in a frame and let it go; return True, with the box still in the hand, where something
        has moved meanwhile."""
        carried = self.moves.carried[arm]
        yield from self.moves.others_home(arm)
        among, (place, yaw, turn) = self.moves.surroundings(), goal()
        above = place + np.array([0, 0, self.moves.grasp.let_go])
        reach = yield from self.moves.planned(self.moves.planner.put, carried, above, yaw, among, turn)
        moved = yield from self.moves.follow(reach.approach, aim=frame, held=carried.box)
        if moved:
            return True
        aimed = {name: pose for name, pose in among.poses.items() if name == frame}
        moved = yield from self.moves.straight(arm, reach.line, watch=aimed, aim=frame, held=carried.box)
        if moved:
            return True
        self.committed = True
        jammed = yield from self._let_go(arm)
        yield from self.moves.straight(arm, reach.line[::-1])
        self.committed = False
        if jammed is not None:
            raise jammed
        return False

    def _let_go(self, arm: str) -> Generator[None, None, Failed | None]:
        """Open the fingers around what an arm holds. Return what went wrong where they do not open, told to hold it again:
        the arm then takes it along, and knows that it does."""
        carried = self.moves.carried[arm]
        self.moves.release(carried)
        try:
            yield from self.moves.fingers(arm, at_least=self.moves.around(arm, self.moves.width(carried)))
        except Failed as jammed:
            self.moves.grip(carried)
            yield from self.moves.fingers(arm)
            return jammed
        del self.moves.carried[arm]
        self.moves.known[carried.box] = self.moves.robot.forward(arm, self.moves.link.arm(arm).commanded) * carried.pose
        return None

    def _hand_over(self, box: str, arm: str, goal: Goal) -> Routine:
        """Set the box down where an arm that reaches its place can pick it, for the tree to have it picked again."""
        held = self.moves.carried[arm]
        able = [other for other in self.moves.link.arms if other != arm and self._reaches(other, goal, held)]
        if not able:
            raise Failed(f"no arm reaches the place for {box}")
        self._avoid[box] = arm
        yield from self._set_down(arm, able[0])

    def _set_down(self, arm: str, other: str | None = None) -> Routine:
        """Put what an arm holds on a free place of a table, one that the `other` reaches too where one is named."""
        carried = self.moves.carried[arm]
        near = self.moves.robot.forward(arm, self.moves.link.arm(arm).commanded).translation
        arms = (arm,) if other is None else (arm, other)
        if other is not None:
            # At the edge of its reach an arm has joints for a pose, but no straight way to it.
            near = _half_way(near, self.moves.robot.arm(arm).base, self.moves.robot.arm(other).base)
        tried = 0
        for spot in self.moves.planner.spots(carried.box, self.moves.obstacles(), near):
            if tried == self.moves.motion.spots:
                break
            if all(self._reaches(name, (spot, 0.0, None), carried) for name in arms):
                tried += 1
                with contextlib.suppress(Unplannable):
                    moved = yield from self._put(arm, _fixed_goal(spot))
                    if not moved:
                        return
            yield
        raise Failed(f"there is no free place to set {carried.box} down")

    def open_all(self) -> Routine:
        """Open all fingers; what is held is set down first."""
        for arm in list(self.moves.carried):
            if self.moves.seen.holding == self.moves.carried[arm].box:
                yield from self._set_down(arm)
            else:
                del self.moves.carried[arm]
        for arm in self.moves.link.arms:
            self._open(arm)
        for arm in self.moves.link.arms:
            yield from self.moves.fingers(arm, at_least=0.95 * self.moves.robot.arm(arm).gripper.opening)

    def close_all(self) -> Routine:
        """Close all fingers."""
        self.committed = True
        for arm in self.moves.link.arms:
            self.moves.link.grip(arm, 0.0, self.moves.grasp.force)
        for arm in self.moves.link.arms:
            yield from self.moves.fingers(arm)

    def _open(self, arm: str) -> None:
        """Begin to open an arm's fingers as far as they go."""
        self.moves.link.grip(arm, self.moves.robot.arm(arm).gripper.opening, self.moves.grasp.force)

    def _arm_with(self, box: str) -> str:
        for arm, carried in self.moves.carried.items():
            if carried.box in self.task.instances[box]:
                return arm
        raise Failed(f"no hand holds {box}")

    def _goal(self, box: str, place: Place) -> Goal:
        """Return where an object should be in the base frame, along which direction the frame's axes are, and how it should
        be turned in it."""
        if place.frame == self.task.robot_frame:
            return np.array(place.position), 0.0, place.turn
        pose = self.moves.known[place.frame]
        along_edges = place.turn is None and self.task.thing(box).is_cube
        yaw = yaw_of(pose.rotation) if along_edges else heading(pose.rotation)
        return pose.apply(place.position), yaw, place.turn

    def _reaches(self, arm: str, goal: Goal, held: Carried) -> bool:
        """Can an arm put what is held in its TCP's frame there?"""
        place, yaw, turn = goal
        groups = put_poses(place, yaw, held.pose, self.task.thing(held.box), turn)
        return any(self.moves.planner.can_reach(arm, pose) for poses in groups for pose in poses)


def _half_way(point: Point, first: Point, second: Point) -> Point:
    """Return the point that is nearest to one, of those as far from `first` as from `second`."""
    across = (second - first) / np.linalg.norm(second - first)
    return point - across * np.dot(across, point - (first + second) / 2)


def _fixed_goal(spot: Point) -> Callable[[], Goal]:
    """Return a goal that does not move."""
    return lambda: (spot, 0.0, None)
