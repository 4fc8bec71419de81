"""Rigid-body physics behind one protocol: objects are released at rest, and the question is where they end.

`poses` are xyz (world, metres) and a unit quaternion wxyz; `kits` are the world positions of the kits' frames.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float32, Int32

from bt_jax.mjx_env.world import Array

__all__ = ["QUIET_STEPS", "AtOnce", "CompiledPhysics", "Physics", "SettleFn", "Settled", "Stepper"]

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


@runtime_checkable
class Stepper(Protocol):
    """A backend as pure functions of JAX arrays, for compiled loops: W problems are stepped together, and each is over when
    it rests, whatever the others do. A motion is a pytree whose leaves have W rows."""

    @property
    def lanes(self) -> int | None:
        """How many problems are best stepped together; None where any number is."""
        ...

    def begin(
        self, kits: Float32[jax.Array, "W T 3"], poses: Float32[jax.Array, "W B 7"], present: Bool[jax.Array, "W B"]
    ) -> Any:
        """Return motions that begin as those of `Physics.settle` do; they rest at once where nothing is present."""
        ...

    def step(self, motion: Any) -> Any:
        """Return the motions one physics step later; what those do that rest means nothing."""
        ...

    def rests(self, motion: Any) -> Bool[jax.Array, " W"]:
        """Return which motions are over; one whose numbers are all 0 is."""
        ...

    def settled(self, motion: Any) -> Settled:
        """Return where the motions have come to."""
        ...


@runtime_checkable
class CompiledPhysics(Physics, Protocol):
    """A backend that compiled loops can call."""

    @property
    def stepper(self) -> Stepper:
        """The same physics, step by step. Equal ones must compile to the same code."""
        ...


@dataclasses.dataclass(frozen=True)
class AtOnce:
    """`Stepper` of a backend whose problems are solved in one go."""

    settle: SettleFn
    lanes: int | None = None

    def begin(
        self, kits: Float32[jax.Array, "W T 3"], poses: Float32[jax.Array, "W B 7"], present: Bool[jax.Array, "W B"]
    ) -> Settled:
        """See `Stepper.begin`."""
        return self.settle(kits, poses, present)

    def step(self, motion: Settled) -> Settled:
        """See `Stepper.step`."""
        return motion

    def rests(self, motion: Settled) -> Bool[jax.Array, " W"]:
        """See `Stepper.rests`."""
        return jnp.ones(motion.ok.shape, bool)

    def settled(self, motion: Settled) -> Settled:
        """See `Stepper.settled`."""
        return motion
