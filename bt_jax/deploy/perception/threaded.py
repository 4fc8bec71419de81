"""Perception in a thread of its own, so that a slow image never delays a tick."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Generic, TypeVar

from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.observation import Finding
from bt_jax.deploy.execution.observer import Perceiving

__all__ = ["BackgroundPerception"]

FIRST = 30.0  # seconds for the first image
P = TypeVar("P", bound=Perceiving)


class BackgroundPerception(Generic[P]):
    """Look without a pause. `make` is called in the thread, since a renderer belongs to the thread that made it; `close` is
    called with what was made. Use it as a context manager."""

    def __init__(self, make: Callable[[], P], close: Callable[[P], None] = lambda made: None) -> None:
        self._make, self._close = make, close
        self._perception: P | None = None
        self._problem: BaseException | None = None
        self._ready, self._closing = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="perception", daemon=True)

    def __enter__(self) -> BackgroundPerception[P]:
        self._thread.start()
        self._ready.wait(FIRST)
        self.update()
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.set()
        self._thread.join(2)

    def update(self) -> None:
        """Raise what ended the thread, if something did."""
        if self._problem is not None:
            raise self._problem

    def poses(self, now: float) -> Mapping[str, RigidTransform]:
        """Return the poses of the perception in the thread; none before its first image."""
        return {} if self._perception is None else self._perception.poses(now)

    @property
    def image(self) -> float:
        return float("-inf") if self._perception is None else self._perception.image

    @property
    def lost(self) -> str:
        return "" if self._perception is None else self._perception.lost

    def findings(self, now: float) -> tuple[Finding, ...]:
        """Return those of the perception in the thread."""
        return () if self._perception is None else self._perception.findings(now)

    def measured(self) -> Mapping[str, float]:
        """Return those of the perception in the thread."""
        return {} if self._perception is None else self._perception.measured()

    def _run(self) -> None:
        try:
            made = self._make()
            made.update()
            self._perception = made
            self._ready.set()
            while not self._closing.wait(0.005):
                made.update()
            self._close(made)
        except BaseException as problem:
            self._problem = problem
            self._ready.set()
