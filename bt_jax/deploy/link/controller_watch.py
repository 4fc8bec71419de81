"""Watches grippers and controller over Robot Web Services, in a thread, by the clock.

Readings are polled, not subscribed to: whether the robot runs, EGM tells 250 times a second, and the link process acts on
that. Over Robot Web Services come only the grippers, five times a second, and the reason for a state in words; a websocket
would be a second connection with its own ways to fail for what a few requests do.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.rapid_program import RapidProgram
from bt_jax.deploy.link.settings import LinkTiming

__all__ = ["ControllerWatch"]


class ControllerWatch:
    """Reads one gripper after the other, and now and then the controller's state.

    `stop` is told why the robot must stop: the controller is not in the state in which a robot moves, or has been silent for
    too long. It is told only while `enabled` holds. `look` is called every round.
    """

    def __init__(
        self,
        program: RapidProgram,
        timing: LinkTiming,
        *,
        enabled: Callable[[], bool],
        stop: Callable[[str], object],
        look: Callable[[], None],
    ) -> None:
        self._program, self._timing = program, timing
        self._enabled, self._stop, self._look = enabled, stop, look
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def close(self) -> None:
        """End, as soon as the request that is under way does."""
        self._closing.set()
        self._thread.join(self._timing.silent + 1)

    def _run(self) -> None:
        answered = asked = time.monotonic()
        while not self._closing.wait(self._timing.poll):
            self._look()
            if self._program.stopping:  # its requests come first
                continue
            try:
                self._program.read_next_opening()
                if self._enabled() and time.monotonic() - asked >= self._timing.state:
                    asked = time.monotonic()
                    state = self._program.state()
                    if self._enabled() and not (state.ready and state.rapid == "running"):
                        self._stop(f"the controller is in {state.control}, mode {state.mode}, RAPID {state.rapid}")
                answered = time.monotonic()
            except (UserError, ValueError) as problem:
                silent = time.monotonic() - answered > self._timing.silent
                if silent and self._enabled() and not self._closing.is_set():
                    self._stop(str(problem))
