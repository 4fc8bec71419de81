"""Plans whole motions: to a grasp, to where a box is set down, and home; which arm, which solution, around what.

A plan is one path to above the place and one straight path down; the way out is the way in. Everything is checked for
clearance with what was last seen of the cell.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy import yumi
from bt_jax.deploy.planning.clearance import Carried, CellClearance
from bt_jax.deploy.planning.grasps import grasp_poses, put_poses, raised
from bt_jax.deploy.planning.kinematics import arm_kinematics
from bt_jax.deploy.planning.paths import Pace, connect, timed
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.tasks import Task

__all__ = ["Planner", "Reach", "Unplannable"]

ABOVE = 0.08  # metres above the place where a straight path begins
STEPS = 8  # of a straight path
SOLUTIONS = 3  # of the inverse kinematics, tried for each pose
LOOKS = 8000  # at clearance, after which a plan is given up; a count, so that it does not depend on the machine
TRIES = 150  # of a search for a way to one of the places
SPOT = 0.02  # metres between places that are tried for setting a box down


class Unplannable(Exception):
    """There is no way; the message says what was in it."""


@dataclasses.dataclass(frozen=True)
class Reach:
    """A motion of one arm: `approach` [n, 7] to above the place, `line` [m, 7] straight down; `tcp` at the end of it."""

    arm: str
    approach: np.ndarray
    line: np.ndarray
    tcp: RigidTransform


class Planner:
    """Plans for one cell. `joints` maps arms to where they are [7]; poses are in the base frame."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self._clearance = CellClearance(task)
        self._seed, self._looks = 0, 0

    def pick(
        self, box: str, poses: Mapping[str, RigidTransform], joints: Mapping[str, np.ndarray], arms: Iterable[str]
    ) -> Reach:
        """To around a box, with the best arm that has a way. Raises Unplannable."""
        targets = [(arm, tcp) for arm in arms for tcp in grasp_poses(poses[box])]
        down = functools.partial(self._clearance.place, poses, gripped=box)
        return self._reach(targets, joints, f"grasp {box}", functools.partial(self._clearance.place, poses), down)

    def put(
        self,
        carried: Carried,
        position: np.ndarray,
        yaw: float,
        supports: Iterable[str],
        poses: Mapping[str, RigidTransform],
        joints: Mapping[str, np.ndarray],
    ) -> Reach:
        """To where a carried box has its centre at `position` [3] and its edges along `yaw`. Raises Unplannable."""
        targets = [(carried.arm, tcp) for tcp in put_poses(position, yaw, carried.pose)]
        across = functools.partial(self._clearance.place, poses, carried=carried)
        down = functools.partial(across, supports=tuple(supports))
        return self._reach(targets, joints, f"put {carried.box} down", across, down)

    def home(
        self,
        arm: str,
        poses: Mapping[str, RigidTransform],
        joints: Mapping[str, np.ndarray],
        carried: Carried | None = None,
    ) -> np.ndarray:
        """Path [n, 7] to the arm's place of rest, around what is carried by either arm. Raises Unplannable."""
        self._looks = 0
        self._clearance.place(poses, carried=carried)
        free = self._free(arm, joints)
        path = connect(joints[arm], yumi.HOME[arm], free, seed=self._next())
        if path is None:
            raise Unplannable(f"the {arm} arm finds no way home")
        return path

    def can_reach(self, arm: str, tcp: RigidTransform) -> bool:
        """Do joints exist for a pose and for the one above it?"""
        kinematics = arm_kinematics(arm)
        return all(kinematics.solve(pose, yumi.HOME[arm]) is not None for pose in (tcp, raised(tcp, ABOVE)))

    def timed(self, arm: str, path: np.ndarray, pace: Pace, joints: Mapping[str, np.ndarray]) -> Trajectory:
        """The path that was planned last, as a trajectory; corners are only cut where there is room for it."""
        trajectory = timed(path, pace, arm)
        if len(path) <= 2:
            return trajectory
        self._looks = 0
        free = self._free(arm, joints)
        if all(free(row) for row in trajectory.joints[::4]):
            return trajectory
        pieces = [timed(path[i : i + 2], pace, arm) for i in range(len(path) - 1)]
        times, rows, end = [np.array([0.0])], [pieces[0].joints[:1]], 0.0
        for piece in pieces:
            times.append(piece.times[1:] + end)
            rows.append(piece.joints[1:])
            end += piece.duration
        return Trajectory(np.concatenate(times), np.concatenate(rows))

    def spots(self, box: str, poses: Mapping[str, RigidTransform], near: np.ndarray) -> Iterator[np.ndarray]:
        """Free places [3] for a box on the tables, the nearest to `near` first; `box` itself is not in its own way."""
        size = next(b.size for b in self.task.boxes if b.name == box)
        base = np.array(self.task.robot_position)
        found = []
        for table in self.task.tables:
            room = np.array(table.size[:2]) / 2 - size
            centre = np.array(table.position[:2]) - base[:2]
            for x in np.arange(-room[0], room[0] + 1e-9, SPOT):
                for y in np.arange(-room[1], room[1] + 1e-9, SPOT):
                    found.append(np.array([*(centre + np.array([x, y])), table.top - base[2] + size / 2]))
        for spot in sorted(found, key=lambda spot: float(np.linalg.norm(spot - near))):
            if all(self._apart(spot, name, pose, size) for name, pose in poses.items() if name != box):
                yield spot

    def _apart(self, spot: np.ndarray, name: str, pose: RigidTransform, size: float) -> bool:
        away = pose.inv().apply(spot)[:2] if name == self.task.kit.name else spot[:2] - pose.translation[:2]
        if name == self.task.kit.name:
            return bool(np.abs(away).max() > self.task.kit.size / 2 + size)
        return bool(np.linalg.norm(away) > 2 * size)

    def _reach(self, targets, joints, what: str, across: Callable[[], None], down: Callable[[], None]) -> Reach:
        """The best way to one of `targets` (arm, TCP). `across` and `down` tell the clearance what may be touched on the
        path to above the place, and on the straight one."""
        self._looks = 0
        candidates, blocked = [], ""
        for arm, tcp in targets:
            kinematics = arm_kinematics(arm)
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
            down()
            free = self._free(arm, joints)
            hit = next((row for row in line if not free(row)), None)
            if hit is not None:
                blocked = blocked or self._between(arm, joints, hit)
                continue
            across()
            free = self._free(arm, joints)
            path = connect(joints[arm], line[0], free, seed=self._next(), tries=TRIES)
            if path is not None:
                return Reach(arm, path, line, tcp)
            blocked = blocked or "no path"
        raise Unplannable(f"there is no free way to {what}: {blocked}")

    def _free(self, arm: str, joints: Mapping[str, np.ndarray]) -> Callable[[np.ndarray], bool]:
        """Is a configuration free? What an arm is too near to already, it may be as near to. Raises Unplannable after too
        many questions for one plan."""
        other = next(name for name in yumi.ARMS if name != arm)

        def slacks(q: np.ndarray) -> np.ndarray:
            self._looks += 1
            if self._looks > LOOKS:
                raise Unplannable(f"there is no way for the {arm} arm that would be found in time")
            left, right = (q, joints[other]) if arm == "left" else (joints[other], q)
            return self._clearance.slacks(left, right)

        least = np.minimum(0.0, slacks(joints[arm]) - 1e-4)
        return lambda q: bool((slacks(q) >= least).all())

    def _between(self, arm: str, joints: Mapping[str, np.ndarray], q: np.ndarray) -> str:
        both = {**joints, arm: q}
        return self._clearance.nearest(both["left"], both["right"])

    def _next(self) -> int:
        self._seed += 1
        return self._seed
