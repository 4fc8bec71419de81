"""Rigid-body physics behind one protocol: objects are released at rest, and the question is where they end.

`poses` are xyz (world, metres) and a unit quaternion wxyz; `kits` are the world positions of the kits' frames.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import jax
from jaxtyping import Bool, Float32, Int32

from bt_jax.mjx_env.world import Array

__all__ = ["QUIET_STEPS", "Physics", "SettleFn", "Settled"]

QUIET_STEPS = 4


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Settled:
    """Where objects came to rest.

    `ok` is False where a value is not finite or an object flew away; the poses are then the last valid ones.
    `steps` is the number of physics steps until rest; where it is the most that the task's `timing` allows, something
    still moved. `reach` is the largest horizontal distance [m] of each object from its start during the motion.
    """

    poses: Float32[Array, "*S B 7"]
    ok: Bool[Array, "*S"]
    steps: Int32[Array, "*S"]
    reach: Float32[Array, "*S B"]


SettleFn = Callable[[Float32[jax.Array, "S T 3"], Float32[jax.Array, "S B 7"], Bool[jax.Array, "S B"]], Settled]
"""`Physics.settle` as a pure function of JAX arrays."""


@runtime_checkable
class Physics(Protocol):
    """A backend."""

    @property
    def name(self) -> str:
        """What it is called in settings."""
        ...

    @property
    def description(self) -> str:
        """What lets objects fall, in a few words."""
        ...

    def settle(
        self, kits: Float32[Array, "S T 3"], poses: Float32[Array, "S B 7"], present: Bool[Array, "S B"]
    ) -> Settled:
        """Release the present objects at rest and step until all rest; the others take no part and keep their pose.

        At rest means QUIET_STEPS steps in a row in which no object is faster than the task's `timing` allows, nor gaining
        speed, or a window of its steps in which all have only rocked in place; what still moves after the most steps that
        it allows counts as at rest where it is. A problem's result
        depends on nothing but the problem.
        """
        ...
