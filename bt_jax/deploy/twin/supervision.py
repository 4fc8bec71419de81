"""The controller's motion supervision in the twin: what presses on an arm from outside."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from jaxtyping import Bool

from bt_jax.deploy.link.egm import CYCLE

__all__ = ["ContactSupervision"]

FILTER = 0.02  # s; estimate: shorter blows than that are taken for noise of the motors' currents


class ContactSupervision:
    """Forces on arms, filtered. A real controller estimates them from the currents of the motors."""

    def __init__(self, model: mujoco.MjModel, joints: Mapping[str, Sequence[int]]) -> None:
        """`joints` are the ids of each arm's joints in chain order: all that moves with the first one is the arm."""
        self._model, self._arms = model, tuple(joints)
        self._part_of = np.full(model.ngeom, len(joints))  # the arm of each geom, by its number; the last is none
        for number, ids in enumerate(joints.values()):
            self._part_of[_moved_by(model, int(model.jnt_bodyid[ids[0]]))[model.geom_bodyid]] = number
        self._share = 1 - math.exp(-CYCLE / FILTER)
        self._forces = np.zeros((len(joints) + 1, 3))

    def advance(self, data: mujoco.MjData) -> dict[str, float]:
        """Take in a cycle; return the size of the force [N] on each arm from all that is not part of it."""
        forces, wrench = np.zeros_like(self._forces), np.zeros(6)
        sides = self._part_of[data.contact.geom]
        for i in np.flatnonzero(sides[:, 0] != sides[:, 1]):
            mujoco.mj_contactForce(self._model, data, i, wrench)
            force = data.contact.frame[i].reshape(3, 3).T @ wrench[:3]  # on the second of the two
            forces[sides[i, 0]] -= force
            forces[sides[i, 1]] += force
        self._forces += self._share * (forces - self._forces)
        return {arm: float(np.linalg.norm(self._forces[number])) for number, arm in enumerate(self._arms)}

    def reset(self) -> None:
        """Forget what was felt."""
        self._forces[:] = 0


def _moved_by(model: mujoco.MjModel, body: int) -> Bool[np.ndarray, " bodies"]:
    """Return which bodies move with a body, itself among them."""
    moved = np.zeros(model.nbody, bool)
    moved[body] = True
    for other in range(body + 1, model.nbody):  # parents come first
        moved[other] = moved[other] or moved[model.body_parentid[other]]
    return moved
