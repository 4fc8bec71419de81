"""The one thread beside the event loop, for what takes longer than a blink, and the physics engine that is used there."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import ParamSpec, TypeVar

from bt_jax.mjx_env.physics.mujoco import MujocoPhysics
from bt_jax.mjx_env.physics.protocol import Physics
from bt_jax.tasks import Task

__all__ = ["Worker"]

P = ParamSpec("P")
T = TypeVar("T")


class Worker:
    """Runs functions one after the other."""

    def __init__(self) -> None:
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="worker")
        self._engine: MujocoPhysics | None = None

    async def work(self, function: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Run a function after those that were given before, and return what it returns."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._thread, lambda: function(*args, **kwargs))

    def physics(self, task: Task) -> Physics:
        """Return the C engine for a task, which needs no compilation; to be used in `work` only."""
        if self._engine is None or self._engine.task is not task:
            self._engine = MujocoPhysics(task, threads=1)
        return self._engine
