"""The RAPID program on the controller, as the link uses it: start and stop, guided motion on request, grippers.

All requests go over Robot Web Services, one at a time, from whichever thread.
"""

from __future__ import annotations

import threading

import numpy as np

from bt_jax.deploy.link.rws import (
    EGM_MOTION,
    GRIP_ACTUAL,
    GRIP_FORCE,
    GRIP_TARGET,
    ControllerState,
    Motion,
    Rws,
    symbol,
)
from bt_jax.deploy.link.settings import LinkConfig

__all__ = ["RapidProgram"]

STRONGEST, WIDEST = 20.0, 0.05  # N and m of the Smart Gripper
MILLIMETRES = 500.0  # mm a finger for a metre between both


class RapidProgram:
    """The program in both arms' tasks. Every call raises UserError where the controller does not answer as it should."""

    def __init__(self, config: LinkConfig) -> None:
        self.arms = tuple(config.ports)
        self.openings = dict.fromkeys(self.arms, 0.0)  # m between the fingers, as read last
        self._lock = threading.Lock()
        self._rws = Rws(config.host, config.rws_port, config.user, config.password)

    def state(self) -> ControllerState:
        """Return the controller's state, asked for now."""
        with self._lock:
            return self._rws.state()

    def start(self) -> None:
        """Start the program from its beginning; the arms stand still until they are asked to follow."""
        with self._lock:
            self._rws.start()

    def stop(self) -> None:
        """Stop the program; the robot brakes along its path."""
        with self._lock:
            self._rws.stop()

    def ask_to_follow(self) -> str | None:
        """Ask the arms that do not follow EGM yet to do so. Return which do not, None where all follow."""
        waiting = []
        with self._lock:
            for arm in self.arms:
                motion = self._rws.number(symbol(arm, EGM_MOTION))
                if motion == Motion.LISTEN:
                    self._rws.set_number(symbol(arm, EGM_MOTION), float(Motion.ASKED))
                if motion != Motion.GUIDED:
                    waiting.append(arm)
        return f"{' and '.join(waiting)}: not guided" if waiting else None

    def end_guided_motion(self) -> None:
        """Have the program end guided motion itself, smoothly; the arms must still be held while it does."""
        with self._lock:
            for arm in self.arms:
                self._rws.set_number(symbol(arm, EGM_MOTION), float(Motion.LISTEN))

    def grip(self, arm: str, opening: float, force: float) -> None:
        """Move an arm's fingers to a distance from each other [m], with a force [N], both clipped to what is possible."""
        with self._lock:
            self._rws.set_number(symbol(arm, GRIP_FORCE), float(np.clip(force, 0, STRONGEST)))
            self._rws.set_number(symbol(arm, GRIP_TARGET), MILLIMETRES * float(np.clip(opening, 0, WIDEST)))

    def read_openings(self) -> None:
        """Read how far apart the fingers are."""
        for arm in self.arms:
            with self._lock:
                self.openings[arm] = self._rws.number(symbol(arm, GRIP_ACTUAL)) / MILLIMETRES

    def close(self) -> None:
        """Close the connection."""
        self._rws.close()
