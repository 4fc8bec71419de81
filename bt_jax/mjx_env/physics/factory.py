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
    why = f"{backend} was asked for"
    if backend == "auto":
        device = jax.default_backend()
        backend = "mujoco" if device == "cpu" else "mjx"
        reason = (
            "JAX runs on a CPU, where the C engine is faster"
            if device == "cpu"
            else f"JAX has an accelerator ({device})"
        )
        why = f"{backend} was chosen because {reason}"
    if backend == "mujoco":
        return MujocoPhysics(task, threads=threads, why=why)
    if backend == "mjx":
        # MJX takes a second to import, and the C engine does without it.
        from bt_jax.mjx_env.physics.mjx import MjxPhysics

        return MjxPhysics(task, implementation=implementation, why=why)
    raise UserError(f"there is no physics backend '{backend}'; use auto, mujoco or mjx")
