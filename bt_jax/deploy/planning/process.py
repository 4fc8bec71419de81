"""A planner in a process of its own, so that no plan delays a tick or a look."""

from __future__ import annotations

import multiprocessing
import signal
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from bt_jax._util.child_process import end_with_parent
from bt_jax._util.errors import UserError
from bt_jax.deploy.planning.planner import Planner
from bt_jax.deploy.robot.model import RobotModel
from bt_jax.tasks import Task

__all__ = ["PlanningProcess"]

START = 60.0  # seconds for the process to import what it needs
_planners: list[Planner] = []  # of the worker: one


class PlanningProcess:
    """Makes plans for one cell, one after the other. Use it as a context manager."""

    def __init__(self, robot: RobotModel, task: Task) -> None:
        self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin, (robot, task))
        self._ready = self._pool.submit(_nothing)

    def __enter__(self) -> PlanningProcess:
        """Wait until the process can plan. Raise UserError if it cannot be started."""
        try:
            self._ready.result(START)
        except (BrokenProcessPool, TimeoutError) as error:
            raise UserError(f"the process that plans cannot be started ({error}); try again") from error
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)

    def submit(self, plan: str, *arguments: Any) -> Future[Any]:
        """Call a method of `Planner` there, with arguments that can be pickled; the future has what it returns or raises."""
        return self._pool.submit(_plan, plan, arguments)


def _begin(robot: RobotModel, task: Task) -> None:
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the executor, which ends this process
    _planners.append(Planner(robot, task))


def _nothing() -> None:
    """Do nothing: the first job, which starts the process."""


def _plan(name: str, arguments: tuple[Any, ...]) -> Any:
    return getattr(_planners[0], name)(*arguments)
