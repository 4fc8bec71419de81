"""What runs in the twin's controller process: the cycles of the simulated robot, in real time or in lock-step."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Mapping
from multiprocessing.connection import Connection

import numpy as np
from jaxtyping import Float

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.egm import CYCLE, Mci
from bt_jax.deploy.link.loop_timing import LoopTimer
from bt_jax.deploy.link.realtime import Snapshot, sleep_until, take_priority
from bt_jax.deploy.link.rws import ControllerMessage
from bt_jax.deploy.robot.arrays import PoseRow
from bt_jax.deploy.twin.rws_server import RwsLimits, serve_rws
from bt_jax.deploy.twin.settings import TIMING, Realism
from bt_jax.deploy.twin.simulated_gripper import GripperFault
from bt_jax.deploy.twin.simulated_robot import CellModel, SimulatedRobot, SimulationDiverged

__all__ = ["PARTS", "STATS", "ControllerSpec", "serve"]

PARTS = ("listen", "step", "speak", "commands")  # of a cycle
STATS = 5  # cycles, missed, unanswered, worst, busy


@dataclasses.dataclass(frozen=True)
class ControllerSpec:
    """What the process needs to begin."""

    cell: CellModel
    ports: dict[str, int]
    rws_port: int
    realtime: bool
    realism: Realism


def serve(spec: ControllerSpec, state: Snapshot, stats: Snapshot, watch: LoopTimer, pipe: Connection) -> None:
    """Run until the program above closes the pipe or says so."""
    take_priority(
        realtime=spec.realtime
    )  # before the server's threads start: they inherit it, and never hold the interpreter while they wait
    try:
        robot = SimulatedRobot(spec.cell, spec.ports, spec.realism)
        limits = RwsLimits(rate=math.inf)  # where time is simulated, no second by the clock is meant
        if spec.realtime:
            limits = RwsLimits(spec.realism.requests, spec.realism.request_delay)
        server = serve_rws(robot, spec.rws_port, limits)
    except Exception as error:  # whatever it is: the program above says it
        pipe.send(("failed", _sentence(error)))
        return
    loop = _ControllerLoop(spec, robot, state, stats, watch, pipe)
    pipe.send(("ready", server.server_address[1]))
    try:
        if spec.realtime:
            loop.run_realtime()
        else:
            loop.run_lockstep()
    except Exception as error:  # the arms no longer move, and their feedback ends, as after a power cut
        pipe.send(("failed", _sentence(error)))


def _sentence(error: Exception) -> str:
    """Return what went wrong, with its kind unless it was raised for people to read."""
    if isinstance(error, KeyError) and len(error.args) == 1:
        return str(error.args[0])
    if isinstance(error, OSError) and error.strerror:
        return error.strerror.lower()
    plain = isinstance(error, ValueError | UserError | SimulationDiverged)
    return str(error) if plain else f"{type(error).__name__}: {error}"


class _ControllerLoop:
    def __init__(
        self,
        spec: ControllerSpec,
        robot: SimulatedRobot,
        state: Snapshot,
        stats: Snapshot,
        watch: LoopTimer,
        pipe: Connection,
    ) -> None:
        self.robot, self.state, self.stats, self.watch, self.pipe = robot, state, stats, watch, pipe
        self.realtime = spec.realtime
        self.closing = False
        self.missed, self.worst, self.busy = 0, 0.0, 0.0
        self.publish()

    def publish(self) -> None:
        robot = self.robot
        now = time.monotonic() if self.realtime else robot.time
        self.state.write(np.array([now, *robot.data.qpos]))
        self.stats.write(np.array([robot.cycle, self.missed, robot.unanswered, self.worst, self.busy]))

    def cycle(self) -> None:
        robot = self.robot
        for arm in robot.arms:
            waits = not self.realtime and arm.heard and arm.mci == Mci.RUNNING and arm.silent < TIMING.patience
            robot.listen(arm, (TIMING.faulty if arm.network.broken else TIMING.setpoint) if waits else 0.0)
        self.watch.done("listen")
        robot.step()
        self.watch.done("step")
        robot.speak()
        self.publish()
        self.watch.done("speak")

    def run_realtime(self) -> None:
        deadline = time.monotonic() + CYCLE
        while not self.closing:
            late = sleep_until(deadline)
            began = time.monotonic()
            self.watch.begin(late)
            self.worst = max(self.worst, late)
            behind = int(late / CYCLE)  # cycles that should have begun meanwhile: the arms moved on without setpoints
            self.missed += behind
            for _ in range(min(behind, TIMING.catch_up)):
                self.robot.step()
            self.cycle()
            deadline += (1 + behind) * CYCLE
            self.busy += time.monotonic() - began
            while self.pipe.poll():
                self.command()
            self.watch.done("commands")
            self.watch.end(deadline)

    def run_lockstep(self) -> None:
        self.robot.speak()
        while not self.closing:
            self.command()

    def command(self) -> None:
        """Do what the program above asks for and answer it; end if it is gone."""
        try:
            name, *arguments = self.pipe.recv()
        except (EOFError, OSError):
            self.closing = True
            return
        try:
            self.pipe.send(("done", getattr(self, f"do_{name}")(*arguments)))
        except (KeyError, ValueError, TypeError) as error:  # of the call; what else is raised ends the process
            self.pipe.send(("refused", _sentence(error)))

    def do_advance(self, until: float) -> None:
        if self.realtime:
            raise ValueError("it runs in real time")
        began = time.monotonic()
        while self.robot.time < until - 1e-6:
            self.cycle()
        self.busy += time.monotonic() - began

    def do_put(self, body: str, pose: PoseRow) -> None:
        self.robot.put(body, pose)

    def do_push(self, body: str, force: Float[np.ndarray, " 3"], seconds: float) -> None:
        self.robot.pushes.append((self.robot.model.body(body).id, force, self.robot.time + seconds))

    def do_fault(self, kind: str, details: Mapping[str, float]) -> None:
        self.robot.fault(kind, details)

    def do_gripper_fault(self, fault: str) -> None:
        self.robot.gripper_fault(GripperFault(fault))

    def do_start(self) -> bool:
        return self.robot.start_rapid()

    def do_messages(self) -> list[ControllerMessage]:
        return list(self.robot.messages)

    def do_close(self) -> None:
        self.closing = True
