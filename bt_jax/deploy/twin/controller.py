"""The twin's controller: a process of its own that owns the simulated cell and plays the robot's side of the link.

It starts with its motors on and no program running, and sends feedback for each arm every 4 ms. Robot Web Services or a
person start the program, which moves the arms where the answers say once it is asked for guided motion.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.loop_timing import LateRound, LoopTimer
from bt_jax.deploy.link.protocol import ControllerGone
from bt_jax.deploy.link.realtime import CONTEXT, Snapshot
from bt_jax.deploy.link.rws import ControllerMessage
from bt_jax.deploy.twin.controller_process import PARTS, STATS, ControllerSpec, serve
from bt_jax.deploy.twin.settings import TIMING, Realism
from bt_jax.deploy.twin.simulated_gripper import GripperFault
from bt_jax.deploy.twin.simulated_robot import CellModel

__all__ = ["Controller", "ControllerStats"]


@dataclasses.dataclass(frozen=True)
class ControllerStats:
    """What the process counted since it began."""

    cycles: int
    missed: int  # began more than a cycle late
    unanswered: int  # cycles of one arm in which the program was running and no setpoint came
    worst: float  # seconds by which a cycle began late
    busy: float  # seconds spent on simulation and messages


class Controller:
    """Handle of the process. Arms, grippers and limits are as real as `realism` says, by default perfect. Use it as a
    context manager; `start` and `stop` otherwise."""

    def __init__(
        self,
        cell: CellModel,
        *,
        ports: Mapping[str, int],
        rws_port: int = 0,
        realtime: bool = True,
        realism: Realism | None = None,
    ) -> None:
        ports = dict(ports)
        self._state = Snapshot(1 + len(cell.qpos))
        self._stats = Snapshot(STATS)
        self._watch = LoopTimer(PARTS)
        self._pipe, theirs = CONTEXT.Pipe()
        spec = ControllerSpec(cell, ports, rws_port, realtime, realism or Realism.perfect())
        self._process = CONTEXT.Process(
            target=serve, args=(spec, self._state, self._stats, self._watch, theirs), daemon=True
        )
        self._theirs = theirs
        self.ports, self.realtime = ports, realtime
        self.rws_port = rws_port

    def start(self) -> Controller:
        """Start the process and wait until it is ready. Raise UserError if the cell cannot be simulated."""
        self._process.start()
        self._theirs.close()
        kind, value = self._receive()
        if kind != "ready":
            raise UserError(f"the twin's controller did not start ({value}); fix the cell or free its ports")
        self.rws_port = value
        return self

    def stop(self) -> None:
        """End the process."""
        if self._process.is_alive():
            with contextlib.suppress(ControllerGone):
                self._ask("close")
            self._process.join(2)
        self.kill()

    def kill(self) -> None:
        """End the process at once, as a power cut would."""
        if self._process.pid is not None:
            self._process.kill()
            self._process.join()

    __enter__ = start

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def alive(self) -> bool:
        return self._process.is_alive()

    @property
    def pid(self) -> int | None:
        return self._process.pid

    def state(self) -> tuple[float, Float[np.ndarray, " nq"]]:
        """Return the time [s] (monotonic, or simulated in lock-step) and a copy of qpos; never wait for the simulation."""
        values = self._state.read()
        return float(values[0]), values[1:]

    def stats(self) -> ControllerStats:
        """Return what the process has counted so far."""
        cycles, missed, unanswered, worst, busy = self._stats.read()
        return ControllerStats(int(cycles), int(missed), int(unanswered), float(worst), float(busy))

    def late_cycles(self) -> list[LateRound]:
        """Return the last cycles that began late in real time."""
        return self._watch.read()

    def advance(self, until: float) -> None:
        """Simulate until that time [s], in lock-step only. Raise ControllerGone if the process has ended."""
        self._ask("advance", until)

    def put(self, body: str, pose: RigidTransform) -> None:
        """Move a free body, or the kit, to a pose in the world of the model, at rest, as a person's hand does."""
        self._ask("put", body, np.array([*pose.translation, *pose.rotation.as_quat(scalar_first=True)]))

    def push(self, body: str, force: Float[np.ndarray, " 3"], seconds: float) -> None:
        """Pull at a body with a force [N] in the world for some time."""
        self._ask("push", body, np.asarray(force, float), seconds)

    def fault(self, kind: str, **details: float) -> None:
        """Break something: `drop` (share, in both directions), `delay` (seconds), `reorder` (share), `silence` (seconds),
        `motors_off`, `emergency_stop`, `heal` (the network)."""
        self._ask("fault", kind, details)

    def gripper_fault(self, fault: GripperFault) -> None:
        """Have all grippers work as they should, not move as they are told, or hardly press, from now on."""
        self._ask("gripper_fault", str(fault))

    def press_start(self) -> None:
        """Start the RAPID program, as a person does on the pendant."""
        if not self._ask("start"):
            raise UserError("the twin's controller does not start its program; switch its motors on")

    def messages(self) -> list[ControllerMessage]:
        """Return the controller's event log, the oldest line first."""
        return self._ask("messages")

    def _ask(self, name: str, *arguments: object) -> Any:
        """Return the answer of the process. Raise UserError if it refuses the call, ControllerGone if it has ended."""
        with contextlib.suppress(OSError):  # then it says why, or is gone without a word
            self._pipe.send((name, *arguments))
        kind, value = self._receive()
        if kind == "refused":
            raise UserError(f"the twin's controller refuses {name}: {value}; fix the call")
        if kind == "failed":
            raise ControllerGone(f"the controller's process has failed ({value})")
        return value

    def _receive(self) -> Any:
        try:
            if self._pipe.poll(TIMING.process):
                return self._pipe.recv()
        except (EOFError, OSError) as error:
            raise ControllerGone("the controller's process has ended") from error
        raise ControllerGone(f"the controller's process did not answer for {TIMING.process:g} s")
