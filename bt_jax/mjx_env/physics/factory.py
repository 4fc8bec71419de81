"""The physics of a task, chosen by name."""

from __future__ import annotations

import jax

from bt_jax._util.errors import UserError
from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.tasks import Task

__all__ = ["make_physics"]


def make_physics(
    task: Task, backend: str = "auto", *, threads: int | None = None, implementation: str = "jax"
) -> Physics:
    """Return the physics of a task.

    `backend`: "mujoco" (C engine on `threads` threads, default one per core), "mjx" (batched on JAX's default device;
    `implementation` "jax" or, on NVIDIA, "warp") or "auto": mjx on an accelerator, mujoco on a CPU.
    Raises UserError if the choice does not exist here.
    """
    if backend == "auto":
        backend = "mujoco" if jax.default_backend() == "cpu" else "mjx"
    if backend == "mujoco":
        return MujocoPhysics(task, threads=threads)
    if backend == "mjx":
        # MJX takes a second to import, and the C engine does without it.
        from bt_jax.mjx_env.physics.mjx import MjxPhysics

        return MjxPhysics(task, implementation=implementation)
    raise UserError(f"there is no physics backend '{backend}'; use auto, mujoco or mjx")
