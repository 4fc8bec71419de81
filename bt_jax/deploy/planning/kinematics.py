"""Inverse kinematics of one arm: damped least squares from many starts, since a single one finds only part of what is there.

A pose of the tool has several solutions, for a redundant arm infinitely many: of those found, the one that is near where the
arm is and away from the joints' limits is best.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.robot.arrays import JointRows, Joints
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.deploy.robot.urdf import urdf

__all__ = ["MARGIN", "ArmKinematics"]

MARGIN = np.radians(3.0)  # kept from the limits of the joints
ITERATIONS = 60
STARTS = 30
EXACT = 1e-5  # m and rad
DAMPING = 1e-6
STEP = 0.4  # rad a joint may turn in one iteration
LIMITS = 0.3  # weight of nearness to limits against distance


class ArmKinematics:
    """Kinematics of the TCP of one arm in the robot's base frame; joints in chain order, rad."""

    def __init__(self, robot: RobotModel, arm: str) -> None:
        self.arm = robot.arm(arm)
        self.lower, self.upper = self.arm.lower + MARGIN, self.arm.upper - MARGIN
        self._model = pin.buildModelFromXML(urdf(robot, (arm,), fingers=False))
        self._data = self._model.createData()
        self._tcp = self._model.getFrameId(f"{arm}_tcp")
        self._middle, self._half = (self.lower + self.upper) / 2, (self.upper - self.lower) / 2

    def descend(self, target: RigidTransform, start: Joints, iterations: int = ITERATIONS) -> Joints | None:
        """Return the solution that damped least squares reach from `start`, None if they find none."""
        goal = pin.SE3(target.rotation.as_matrix(), np.array(target.translation))
        return self._descend(goal, start, iterations)

    def _descend(self, goal: pin.SE3, start: Joints, iterations: int) -> Joints | None:
        model, data, q = self._model, self._data, np.clip(start, self.lower, self.upper)
        best = np.inf
        for i in range(iterations):
            pin.framesForwardKinematics(model, data, q)
            error = pin.log6(data.oMf[self._tcp].actInv(goal)).vector
            size = float(np.abs(error).max())
            if size < EXACT:
                return q
            if i % 12 == 11:
                if size > 0.7 * best:
                    return None  # it goes nowhere
                best = size
            jacobian = pin.computeFrameJacobian(model, data, q, self._tcp, pin.LOCAL)
            step = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + (DAMPING + 0.01 * size**2) * np.eye(6), error)
            q = np.clip(q + step * min(1.0, STEP / np.abs(step).max()), self.lower, self.upper)
        return None

    def solutions(
        self, target: RigidTransform, near: Joints, *, seed: int = 0, starts: int = STARTS
    ) -> Iterator[Joints]:
        """Yield solutions, the one found from `near` first, then those from random starts that grow in distance from it."""
        rng, goal = np.random.default_rng(seed), pin.SE3(target.rotation.as_matrix(), np.array(target.translation))
        for i in range(starts):
            spread = min(1.0, 0.15 * i)
            random = rng.uniform(self.lower, self.upper)
            found = self._descend(goal, near + spread * (random - near), ITERATIONS)
            if found is not None:
                yield found

    def solve(self, target: RigidTransform, near: Joints, *, enough: int = 1, seed: int = 0) -> Joints | None:
        """Return the best of the first `enough` solutions, None if there is none."""
        found = []
        for solution in self.solutions(target, near, seed=seed):
            found.append(solution)
            if len(found) == enough:
                break
        return min(found, key=lambda q: self.cost(q, near), default=None)

    def cost(self, joints: Joints, near: Joints) -> float:
        """Return how undesirable a solution is: weighted distance [rad] from `near`, and nearness to the limits."""
        share = np.abs(joints - self._middle) / self._half
        return float(np.linalg.norm(self.arm.weights * (joints - near)) + LIMITS * np.sum(share**8))

    def line(self, target: RigidTransform, start: Joints, steps: int) -> JointRows | None:
        """Return steps + 1 configurations along which the TCP moves straight from where it is at `start` to `target`,
        turning evenly; None if it cannot."""
        here = self.arm.forward(start)
        turn = (here.rotation.inv() * target.rotation).as_rotvec()
        rows = [np.asarray(start, float)]
        for part in np.linspace(0, 1, steps + 1)[1:]:
            position = here.translation + part * (target.translation - here.translation)
            rotation = here.rotation * type(here.rotation).from_rotvec(part * turn)
            found = self.descend(RigidTransform.from_components(position, rotation), rows[-1], 20)
            if found is None or not np.abs(found - rows[-1]).max() <= 0.5:
                return None
            rows.append(found)
        return np.array(rows)
