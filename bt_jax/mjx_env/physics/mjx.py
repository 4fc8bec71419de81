"""MJX: all problems in one compiled loop, for accelerators and for use inside other compiled loops.

The loop has a fixed number of lanes; a lane whose problem is at rest takes the next.
"""

from __future__ import annotations

import dataclasses
import functools
import importlib
import math

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float32, Int32

from bt_jax._util.compile_cache import kept_jit
from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics.mjx_model import Model, Motion, model_of
from bt_jax.mjx_env.physics.protocol import QUIET_STEPS, Settled, SettleFn, Stepper
from bt_jax.tasks import Task

__all__ = ["MjxPhysics", "settle_fn"]

Host = jax.Array | np.ndarray


class MjxPhysics:
    """`Physics` by MJX; the arrays of the result are on JAX's default device. Batches are padded to powers of four, so
    that few shapes are compiled."""

    name = "mjx"
    description = "MJX, MuJoCo in JAX"

    def __init__(self, task: Task, *, implementation: str = "jax", lanes: int | None = None) -> None:
        self.task = task
        self.stepper = _stepper(task, lanes, implementation)
        self._settle = functools.partial(_settle_kept, self.stepper)

    def settle(
        self, kits: Float32[Host, "S T 3"], poses: Float32[Host, "S B 7"], present: Bool[Host, "S B"]
    ) -> Settled:
        """See `Physics.settle`."""
        count = len(poses)
        bucket = _bucket(count)

        def pad(values, dtype):
            values = np.asarray(values, dtype)
            return np.concatenate([values, np.broadcast_to(values[:1], (bucket - count, *values.shape[1:]))])

        # Nothing is present in what is only padding, so that it rests at once.
        here = pad(present, bool)
        here[count:] = False
        result = self._settle(pad(kits, np.float32), pad(poses, np.float32), here)
        return jax.tree.map(lambda values: values[:count], result)


def _bucket(count: int) -> int:
    """Return the power of four that a batch is padded to; an accelerator solves a thousand problems as fast as a few."""
    smallest = 2 if jax.default_backend() == "cpu" else 5
    return 4 ** max(smallest, math.ceil(math.log(max(count, 1), 4)))


def settle_fn(task: Task, *, lanes: int | None = None, implementation: str = "jax") -> SettleFn:
    """Return the pure function `(kits, poses, present) -> Settled` of a task, to be jitted or used in jitted functions.

    `lanes` is how many problems are stepped at once (default: 64 on a CPU, 4096 elsewhere; never more than problems).
    Raises UserError if the implementation does not exist here.
    """
    return functools.partial(_settle, _stepper(task, lanes, implementation))


def _stepper(task: Task, lanes: int | None, implementation: str) -> Stepper:
    """Return MJX step by step. Raise UserError if the implementation does not exist here."""
    if implementation not in ("jax", "warp"):
        raise UserError(f"MJX has no implementation '{implementation}'; use jax or warp")
    lanes = lanes or (64 if jax.default_backend() == "cpu" else 4096)
    if implementation == "warp":
        _check_warp()
        return _warp_stepper(_only_bodies(task), lanes)
    return _JaxStepper(_only_bodies(task), lanes)


class _Stepper:
    """`Stepper` by a model of MJX."""

    lanes: int
    model: Model

    def begin(
        self, kits: Float32[Array, "W T 3"], poses: Float32[Array, "W B 7"], present: Bool[Array, "W B"]
    ) -> Motion:
        """See `Stepper.begin`."""
        return jax.vmap(self.model.begin)(kits, poses, present)

    def step(self, motion: Motion) -> Motion:
        """See `Stepper.step`."""
        return jax.vmap(self.model.step)(motion)

    def rests(self, motion: Motion) -> Bool[Array, " W"]:
        """See `Stepper.rests`."""
        return (motion.quiet >= QUIET_STEPS) | (motion.steps >= self.model.scales.most_steps) | ~motion.ok

    def settled(self, motion: Motion) -> Settled:
        """See `Stepper.settled`."""
        poses = jnp.where(motion.present[..., None], motion.poses, motion.start)
        return Settled(poses, motion.ok, motion.steps, jnp.where(motion.present, motion.reach, jnp.float32(0)))


@dataclasses.dataclass(frozen=True)
class _JaxStepper(_Stepper):
    """Names what its compiled form depends on, so that `kept_jit` can keep that."""

    task: Task
    lanes: int

    @property
    def model(self) -> Model:  # type: ignore[override]  # made once, when it is compiled
        return model_of(self.task)


class _WarpStepper(_Stepper):
    """No dataclass, so that `kept_jit` keeps nothing: the kernels are registered in the process that compiled them."""

    def __init__(self, task: Task, lanes: int) -> None:
        self.lanes, self.model = lanes, model_of(task, warp_lanes=lanes)


@functools.lru_cache(maxsize=16)  # equal ones are compiled once
def _warp_stepper(task: Task, lanes: int) -> _WarpStepper:
    return _WarpStepper(task, lanes)


def _only_bodies(task: Task) -> Task:
    """Return the task without what the simulation does not depend on, so that tasks with the same bodies share compiled
    code."""
    kits = tuple(dataclasses.replace(kit, slots=()) for kit in task.kits)
    blank = Task("", "", task.tables, kits, task.objects, targets=())
    return dataclasses.replace(blank, robot_position=task.robot_position)


def _settle(
    stepper: Stepper,
    kits: Float32[Array, "S T 3"],
    poses: Float32[Array, "S B 7"],
    present: Bool[Array, "S B"],
) -> Settled:
    problems, boxes = present.shape
    width = min(stepper.lanes or problems, problems)
    empty = Settled(
        poses, jnp.ones(problems, bool), jnp.zeros(problems, jnp.int32), jnp.zeros((problems, boxes), jnp.float32)
    )

    def begin(problem: Int32[Array, " W"]) -> Motion:
        at = jnp.minimum(problem, problems - 1)
        return stepper.begin(kits[at], poses[at], present[at])

    def body(carry):
        problem, motion, taken, out = carry
        motion = stepper.step(motion)
        done = stepper.rests(motion)
        where = jnp.where(done, problem, problems)  # out of range: dropped
        out = jax.tree.map(lambda all_, new: all_.at[where].set(new, mode="drop"), out, stepper.settled(motion))
        order = jnp.cumsum(done.astype(jnp.int32)) - 1
        problem = jnp.where(done, jnp.minimum(taken + order, problems), problem)
        motion = jax.tree.map(lambda new, old: jnp.where(_align(done, new), new, old), begin(problem), motion)
        return problem, motion, taken + done.sum(dtype=jnp.int32), out

    first = jnp.arange(width, dtype=jnp.int32)
    start = (first, begin(first), jnp.int32(width), empty)
    return jax.lax.while_loop(lambda carry: jnp.any(carry[0] < problems), body, start)[3]


_settle_kept = kept_jit(_settle, static_argnames=("stepper",))


def _align(mask, values):
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))


def _check_warp() -> None:
    try:
        importlib.import_module("warp")
    except ImportError:
        raise UserError('implementation "warp" needs the package warp-lang; install bt_jax[cuda], or use jax') from None
    if jax.default_backend() != "gpu":
        raise UserError('implementation "warp" needs an NVIDIA GPU that JAX can see; use jax')
