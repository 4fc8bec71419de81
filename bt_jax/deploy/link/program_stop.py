"""The stop of the robot's program, which is asked for until the controller confirms it."""

from __future__ import annotations

import contextlib
import threading

from bt_jax.deploy.link.rws import Rws

__all__ = ["UNCONFIRMED", "ProgramStop"]

UNCONFIRMED = "not confirmed that the robot's program has stopped: press the stop"


class ProgramStop:
    """Stops the RAPID program, and believes it only when the controller says that RAPID is stopped.

    It has a session of its own, so that it waits for no reading that hangs, and for no request budget.
    """

    def __init__(self, rws: Rws, retry: float) -> None:
        self._rws, self._retry = rws, retry  # `retry`: seconds between two tries
        self._confirmed, self._given_up = threading.Event(), threading.Event()
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    @property
    def begun(self) -> bool:
        """Was the stop asked for?"""
        return self._thread is not None

    def log_in(self) -> None:
        """Open the session, so that a stop does not have to. Raise UserError if the controller does not answer."""
        self._rws.execution()

    def begin(self) -> None:
        """Begin to stop the program; return at once."""
        with self._lock:
            if self._thread is None or not (self._confirmed.is_set() or self._thread.is_alive()):
                self._thread = threading.Thread(target=self._insist, daemon=True)
                self._thread.start()

    def wait(self, seconds: float) -> bool:
        """Wait until the stop is confirmed; return whether it is."""
        return self._confirmed.wait(seconds)

    def close(self) -> None:
        """Ask no more."""
        self._given_up.set()
        if self._thread is not None:
            self._thread.join()
        self._rws.close()

    def _insist(self) -> None:
        while not self._given_up.is_set():
            with contextlib.suppress(Exception):  # busy, silent, refused, as in manual mode: the state decides
                self._rws.stop()
            with contextlib.suppress(Exception):
                if self._rws.execution() == "stopped":
                    self._confirmed.set()
                    return
            self._given_up.wait(self._retry)
