"""The process that has compiled for the evolution that is likely to be started next."""

from __future__ import annotations

import dataclasses
from typing import Any

from bt_jax.app.processes.train_command import TrainCommand
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.behaviors import gene_pool
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import Task

__all__ = ["Standby"]


class Standby:
    """Keeps at most one warm worker; an evolution takes it, ready or not."""

    def __init__(self, command: TrainCommand, worker: WarmWorker | None = None) -> None:
        self._command, self._worker = command, worker
        self._prepared: Any = None  # what the worker compiles for, None if it was not told yet

    def prepare(self, task: Task, gp: GPConfig) -> None:
        """Compile for an evolution, unless this was done for one that needs the same code."""
        key = gene_pool(task).leaves, dataclasses.replace(gp, seed=0, generations=1, accept_baseline=False)
        worker = self._worker if self._worker is not None and self._worker.alive else None
        if worker is not None and self._prepared == key:
            return
        if worker is None or self._prepared is not None:
            self.discard()
            worker = WarmWorker()
        self._worker, self._prepared = worker, key
        worker.warm(self._command.start(task, gp))

    def take(self) -> WarmWorker:
        """Return the worker, or a new one if it has died; it is no longer on standby."""
        worker = self._worker if self._worker is not None and self._worker.alive else WarmWorker()
        self._worker = self._prepared = None
        return worker

    def discard(self) -> None:
        """End the worker."""
        if self._worker is not None:
            self._worker.discard()
        self._worker = self._prepared = None
