"""Plans whole motions: to a grasp, to where an object is set down, and home; which arm, which solution, around what.

A plan is one path to above the place and one straight path down; the way out is the way in. Everything is checked for
clearance with what was last seen of the cell.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.clearance import GRAZE, SINK, TABLE_MARGIN, WORLD_MARGIN, Carried, CellClearance
from bt_jax.deploy.planning.grasps import grasp_poses, put_poses, raised
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.planning.paths import connect
from bt_jax.deploy.planning.timing import ROUND, Pace, timed
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.arrays import JointRows, Joints, Point
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["JointPath", "Planner", "Reach", "Surroundings"]

ABOVE = 0.08  # metres above the place where a straight path begins
STEPS = 8  # of a straight path
SOLUTIONS = 3  # of the inverse kinematics, tried for each pose
LOOKS = 8000  # at clearance, after which a plan is given up; a count, so that it does not depend on the machine
TRIES = 150  # of a search for a way to one of the places
LOOK_EVERY = 2  # points of a trajectory with rounded corners
SPOT = 0.02  # metres between places that are tried for setting a box down


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """What a motion is planned among: `poses` of objects and kits in the base frame, `joints` where each arm is, and the
    object that one of them carries. Raise Unplannable if any of it is not finite."""

    poses: Mapping[str, RigidTransform]
    joints: Mapping[str, Joints]
    carried: Carried | None = None

    def __post_init__(self) -> None:
        held = {} if self.carried is None else {self.carried.box: self.carried.pose}
        for name, pose in [*self.poses.items(), *held.items()]:
            _require_numbers(f"the pose of {name}", pose.as_matrix())
        for arm, joints in self.joints.items():
            _require_numbers(f"a joint of the {arm} arm", joints)


@dataclasses.dataclass(frozen=True)
class JointPath:
    """A free path of one arm, and what it was planned among."""

    arm: str
    rows: JointRows
    among: Surroundings


@dataclasses.dataclass(frozen=True)
class Reach:
    """A motion of one arm: `approach` to above the place, `line` straight down; `tcp` at the end of it, base frame."""

    arm: str
    approach: JointPath
    line: JointRows
    tcp: RigidTransform


def _require_numbers(what: str, values: Float[np.ndarray, "..."]) -> None:
    """Raise Unplannable if not all are finite: no distance to them would be too small."""
    if not np.isfinite(values).all():
        raise Unplannable(f"{what} is not a number")


class Planner:
    """Plans for a robot in one cell. Poses are in the base frame."""

    def __init__(self, robot: RobotModel, task: Task) -> None:
        self.robot, self.task = robot, task
        self._kinematics = {arm: ArmKinematics(robot, arm) for arm in robot.arm_names}
        self._clearance = CellClearance(robot, task)
        self._seed, self._looks = 0, 0

    def pick(self, box: str, among: Surroundings, arms: Iterable[str]) -> Reach:
        """Plan to around an object, with the best arm that has a way. Raise Unplannable."""
        targets = [(arm, tcp) for arm in arms for tcp in self.grasps(arm, box, among.poses[box])]
        if not targets:
            raise Unplannable(f"there is nothing to grasp {box} by: it lies on its side")
        return self._reach(targets, among, f"grasp {box}", gripped=box)

    def put(
        self, carried: Carried, position: Point, yaw: float, among: Surroundings, turn: float | None = None
    ) -> Reach:
        """Plan to where a carried object has its centre at `position`, on and beside whatever is there; turned by `turn`
        degrees in a frame with its axes along `yaw` [rad], or along these. Raise Unplannable."""
        _require_numbers("the place", np.array([*position, yaw, turn or 0.0]))
        among, problem = dataclasses.replace(among, carried=carried), None
        for poses in put_poses(position, yaw, carried.pose, self.task.thing(carried.box), turn):
            try:
                return self._reach([(carried.arm, tcp) for tcp in poses], among, f"put {carried.box} down")
            except Unplannable as error:
                problem = problem or error
        assert problem is not None
        raise problem

    def grasps(self, arm: str, box: str, pose: RigidTransform) -> list[RigidTransform]:
        """Return the poses of the TCP from which an arm could grasp an object at a pose, its fingers above the rims that are
        beside slots."""
        model = self.robot.arm(arm)
        rims = [kit.wall_height + WORLD_MARGIN for kit in self.task.kits if kit.places]
        return grasp_poses(
            pose, self.task.thing(box), model.gripper.opening, model.below + max(rims, default=TABLE_MARGIN)
        )

    def home(self, arm: str, among: Surroundings) -> JointPath:
        """Plan to the arm's place of rest. Raise Unplannable."""
        self._looks = 0
        free = self._free(arm, among)
        rows = connect(among.joints[arm], self.robot.home[arm], free, self.robot.arm(arm), seed=self._next())
        if rows is None:
            raise Unplannable(f"the {arm} arm finds no way home")
        return JointPath(arm, rows, among)

    def lift(self, arm: str, among: Surroundings) -> JointRows | None:
        """Return a straight line up from where an arm is, as far as it is free; None if it cannot go up at all."""
        self._looks = 0
        here, free = among.joints[arm], self._free(arm, among)
        tcp, kinematics = self.robot.forward(arm, here), self._kinematics[arm]
        lines = (kinematics.line(raised(tcp, ABOVE / share), here, STEPS) for share in (1, 2, 4))
        line = next((line for line in lines if line is not None), None)
        rows = [] if line is None else list(itertools.takewhile(free, line))
        return np.array(rows) if len(rows) > 1 else None

    def can_reach(self, arm: str, tcp: RigidTransform) -> bool:
        """Are there joints for a pose and for the one above it?"""
        if not np.isfinite(tcp.as_matrix()).all():
            return False
        kinematics = self._kinematics[arm]
        return all(kinematics.solve(pose, self.robot.home[arm]) is not None for pose in (tcp, raised(tcp, ABOVE)))

    def timed(self, path: JointPath, pace: Pace) -> Trajectory:
        """Return a path as a trajectory; corners are only rounded where there is room for it."""
        arm = self.robot.arm(path.arm)
        if len(path.rows) <= 2:
            return timed(path.rows, pace, arm)
        self._looks = 0
        free = self._free(path.arm, path.among)
        for round_from in (ROUND, ROUND / 4):
            trajectory = timed(path.rows, pace, arm, round_from=round_from)
            if all(free(joints) for joints in trajectory.joints[::LOOK_EVERY]):
                return trajectory
        return timed(path.rows, pace, arm, round_from=0.0)

    def spots(self, box: str, poses: Mapping[str, RigidTransform], near: Point) -> Iterator[Point]:
        """Yield free places for an object on the tables, the nearest to `near` first; it is not in its own way."""
        thing = self.task.thing(box)
        size = max(thing.size[:2])
        base = np.array(self.task.robot_position)
        found = []
        for table in self.task.tables:
            room = np.array(table.size[:2]) / 2 - size
            centre = np.array(table.position[:2]) - base[:2]
            for x in np.arange(-room[0], room[0] + 1e-9, SPOT):
                for y in np.arange(-room[1], room[1] + 1e-9, SPOT):
                    found.append(np.array([*(centre + np.array([x, y])), table.top - base[2] + thing.height / 2]))
        for spot in sorted(found, key=lambda spot: float(np.linalg.norm(spot - near))):
            if all(self._apart(spot, name, pose, size) for name, pose in poses.items() if name != box):
                yield spot

    def _apart(self, spot: Point, name: str, pose: RigidTransform, size: float) -> bool:
        if name in self.task.kit_names:
            half = self.task.kits[self.task.kit_names.index(name)].half
            return bool(np.any(np.abs(pose.inv().apply(spot)[:2]) > np.array(half) + size))
        away = float(np.linalg.norm(spot[:2] - pose.translation[:2]))
        return away > size + max(self.task.thing(name).size[:2])

    def _reach(
        self,
        targets: Iterable[tuple[str, RigidTransform]],
        among: Surroundings,
        what: str,
        *,
        gripped: str | None = None,
    ) -> Reach:
        """Return the best way to one of `targets` (arm, TCP). On the straight path down, hands may touch the box `gripped`
        and a carried box may come as near to things as it is at the end."""
        self._looks = 0
        joints = among.joints
        candidates: list[tuple[float, str, JointRows, RigidTransform]] = []
        blocked = ""
        for arm, tcp in targets:
            kinematics = self._kinematics[arm]
            above = raised(tcp, ABOVE)
            found = 0
            for top in kinematics.solutions(above, joints[arm], seed=self._next(), starts=6):
                line = kinematics.line(tcp, top, STEPS)
                if line is not None:
                    candidates.append((kinematics.cost(top, joints[arm]), arm, line, tcp))
                    found += 1
                if found == SOLUTIONS:
                    break
        if not candidates:
            raise Unplannable(f"no arm reaches the place to {what}")
        for _, arm, line, tcp in sorted(candidates, key=lambda candidate: candidate[0]):
            hit = self._hit(arm, line, among, gripped)
            if hit:
                blocked = blocked or hit
                continue
            free = self._free(arm, among)
            path = connect(joints[arm], line[0], free, self.robot.arm(arm), seed=self._next(), tries=TRIES)
            if path is not None:
                return Reach(arm, JointPath(arm, path, among), line, tcp)
            blocked = blocked or "no path"
        raise Unplannable(f"there is no free way to {what}: {blocked}")

    def _hit(self, arm: str, line: JointRows, among: Surroundings, gripped: str | None) -> str:
        """Return what is too near on a straight line down, "" if nothing is. At its end a carried box may overlap with what
        is below it, not with what is beside it, which it would still meet a step above."""
        free = self._free(arm, among, gripped=gripped)
        for rows, overlap in ((line[:-1], GRAZE), (line[-1:], SINK)):
            allowed = self._clearance.at_rest({**among.joints, arm: line[-1]}, overlap)
            for row in rows:
                if not free(row, allowed):
                    return self._clearance.nearest({**among.joints, arm: row}, allowed)
        return ""

    def _free(self, arm: str, among: Surroundings, *, gripped: str | None = None) -> Callable[..., bool]:
        """Return what says whether a configuration is free, until it is called again. What an arm is too near to already, it
        may be as near to, as it may where less slack is `allowed`. Raise Unplannable after too many questions for one
        plan."""
        self._clearance.place(among.poses, carried=among.carried, gripped=gripped)
        joints = among.joints

        def slacks(q: Joints) -> Float[np.ndarray, " pairs"]:
            self._looks += 1
            if self._looks > LOOKS:
                raise Unplannable(f"there is no way for the {arm} arm that would be found in time")
            return self._clearance.slacks({**joints, arm: q})

        least = np.minimum(0.0, slacks(joints[arm]) - 1e-4)

        def free(q: Joints, allowed: Float[np.ndarray, " pairs"] | float = 0.0) -> bool:
            return bool((slacks(q) >= np.minimum(least, allowed)).all())

        return free

    def _next(self) -> int:
        self._seed += 1
        return self._seed
