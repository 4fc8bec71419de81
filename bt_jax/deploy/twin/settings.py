"""How long the twin's controller waits, and for what."""

from __future__ import annotations

import dataclasses

__all__ = ["TIMING", "ControllerTiming"]


@dataclasses.dataclass(frozen=True)
class ControllerTiming:
    """How long the twin's controller waits for its client, and its handle for the process, in seconds."""

    process: float = 30.0  # for the process to come up and to answer its handle
    silence: float = 0.5  # without a setpoint after which the controller ends EGM
    setpoint: float = 1.0  # by the clock for which lock-step waits for a setpoint
    faulty: float = 0.01  # the same where setpoints may be lost
    patience: float = 0.04  # simulated, of silence after which lock-step waits no more
    catch_up: int = 12  # cycles that are made up for after a delay; the rest is lost


TIMING = ControllerTiming()
