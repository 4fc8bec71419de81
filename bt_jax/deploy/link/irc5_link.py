"""The link to a robot on an IRC5 controller, or to its twin.

EGM runs in a process of its own (`link.process`), so that neither rendering nor planning can delay a setpoint; the state of
the controller and the grippers go over Robot Web Services from here.
"""

from __future__ import annotations

import contextlib
import socket
import threading
import time

import numpy as np

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.controller_watch import ControllerWatch
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.loop_timing import LateRound
from bt_jax.deploy.link.process import LinkStart, serve
from bt_jax.deploy.link.program_stop import UNCONFIRMED
from bt_jax.deploy.link.protocol import ArmState, ControllerGone, Counters, Records, SimulatedController
from bt_jax.deploy.link.rapid_program import RapidProgram
from bt_jax.deploy.link.realtime import CONTEXT
from bt_jax.deploy.link.reception import USUAL_PORTS, Reception, complaint, senders, title
from bt_jax.deploy.link.rws import ControllerMessage, ControllerState
from bt_jax.deploy.link.safety import Rejected, Rules, check_trajectory
from bt_jax.deploy.link.settings import LinkConfig
from bt_jax.deploy.link.shared_state import COUNTERS, SharedState
from bt_jax.deploy.planning.trajectory import Trajectory

__all__ = ["Irc5Link"]

ENDED, HANGS = "the link process has ended", "the link process does not answer"


class Irc5Link:
    """A robot on an IRC5, or its twin where `controller` is given. Use it as a context manager."""

    def __init__(self, config: LinkConfig, rules: Rules, controller: SimulatedController | None = None) -> None:
        self.config, self.rules, self.arms = config, rules, tuple(config.ports)
        self._timing = config.timing
        self._simulated = None if controller is None or controller.realtime else controller
        self._clearance = rules.clearance_of() if rules.clearance_of is not None else None
        self._blocks = SharedState(self.arms, len(rules.lower))
        self._pipe, theirs = CONTEXT.Pipe()
        start = LinkStart(
            _address(config.host), dict(config.ports), rules, self._simulated is None, config.motion, config.timing
        )
        self._process = CONTEXT.Process(target=serve, args=(start, self._blocks, theirs), daemon=True)
        self._theirs = theirs
        self._pipe_lock = threading.Lock()
        self._program = RapidProgram(config, realtime=self._simulated is None)
        self._target = dict.fromkeys(self.arms, 0.0)
        self._rejected = self._motions = self._drained = 0
        self._counted = [0] * len(COUNTERS)
        self._answering = False  # the robot's program was asked to follow
        self._enabled = False  # and follows
        self._hangs = False  # the link process did not answer: what it says later answers something else
        self._reason: str | None = None  # of a stop that the link process could not be told of
        self._unconfirmed = False  # the controller has not said that the robot's program stopped
        self._closing = threading.Event()
        self._watch: ControllerWatch | None = None

    def open(self) -> Irc5Link:
        """Start the link process and listen. Raise UserError if a port is taken. A controller that does not answer is no
        reason: EGM may come nevertheless, and `state` and `start` say what is wrong."""
        self._process.start()
        self._theirs.close()
        try:
            if not self._pipe.poll(self._timing.startup):
                raise UserError("the link process did not start; close other programs and try again")
            kind, value = self._pipe.recv()
            if kind != "ready":
                ports = ", ".join(map(str, self.config.ports.values()))
                raise UserError(f"the UDP ports {ports} cannot be used ({value}); end the program that uses them")
            with contextlib.suppress(UserError):
                self._program.read_openings()
        except BaseException:
            self.close()
            raise
        self._target |= self._program.openings
        if self._simulated is None:
            self._watch = ControllerWatch(
                self._program,
                self._timing,
                enabled=lambda: self._enabled,
                stop=self.stop,
                look=self._stop_if_dead,
            )
            self._watch.start()
        return self

    __enter__ = open

    def __exit__(self, *_: object) -> None:
        self.close()

    def messages(self) -> list[ControllerMessage]:
        """Return the last lines of the controller's event log, the newest first."""
        return self._program.messages()

    def openings(self) -> dict[str, float]:
        """Return how far apart each arm's fingers are [m], as read last: the arms need not send anything."""
        return dict(self._program.openings)

    def start(self, *, here: bool = False) -> None:
        """Ask the robot's program, which is started if it does not run, for guided motion; from now on the arms hold,
        follow paths, and must keep running. The program begins with the arms at their ready targets, or, with `here`, where
        they are.

        Raise UserError if the controller is not ready or does not begin.
        """
        if not self.config.motion:
            raise UserError("this link only listens; ask for motion to start the robot")
        state = self.state()
        if not state.ready:
            raise UserError(
                f"the controller is in {state.control}, mode {state.mode}; put it in automatic mode with motors on"
            )
        problem = self._ask("answer")
        if problem is not None:
            raise UserError(f"{problem}; ask for motion to start the robot")
        self._program.expect_stop()
        self._answering = True
        if state.rapid != "running":
            self._program.start(here=here)
        problem = "silent"
        deadline = time.monotonic() + self._timing.guided
        while problem is not None and time.monotonic() < deadline:
            if self._simulated is not None:
                self._simulated.advance(self.now() + CYCLE)
            time.sleep(0.005)
            problem = self._program.ask_to_follow() or self._ask("enable")
        if problem is not None:
            raise UserError(self._program.why_not_followed(f"{problem} {self._timing.guided:g} s after the start"))
        self._enabled = True

    def close(self) -> None:
        """Stop the robot's program if it was started, and end the process."""
        self._closing.set()
        with contextlib.ExitStack() as stack:  # each step is done whatever interrupts the one before
            stack.callback(self._end_process)
            if self._answering:
                stack.callback(self._stop_program)
                stack.callback(self._end_motion)
            if self._watch is not None:
                self._watch.close()

    def _end_motion(self) -> None:
        well = self._enabled and self.stopped() is None and self._process.is_alive()
        self._answering = self._enabled = False
        with contextlib.suppress(UserError):
            self._ask("disable")
            if well:
                self._ramp_out()

    def _end_process(self) -> None:
        if self._process.pid is not None:
            with contextlib.suppress(UserError):
                self._ask("close")
            self._process.join(2)
            self._process.kill()
            self._process.join()
        self._program.close()

    def now(self) -> float:
        return time.monotonic() if self._simulated is None else self._simulated.state()[0]

    def wait(self, until: float) -> None:
        self._blocks.alive.value = time.monotonic()
        if self._simulated is None:
            while (left := until - time.monotonic()) > 0:  # who waits is alive, however long
                time.sleep(min(left, self.rules.pause / 3))
                self._blocks.alive.value = time.monotonic()
            return
        try:
            self._stop_if_dead()
            self._simulated.advance(until)
            self._program.read_openings()
        except ControllerGone as gone:
            self.stop(str(gone))
            raise
        except UserError as problem:
            self.stop(str(problem))

    def reception(self, arm: str) -> Reception:
        """Return what came to the port of an arm so far."""
        return Reception.of(self._blocks.receptions[arm].read())

    def elsewhere(self) -> dict[int, str]:
        """Listen for a moment at the usual ports of EGM that are not ours; return those to which something comes, with
        the address of its sender."""
        return senders(sorted(set(USUAL_PORTS) - set(self.config.ports.values())), self._timing.elsewhere)

    def arm(self, arm: str) -> ArmState:
        state = self._blocks.read_arm(arm, opening=self._program.openings[arm], grip_target=self._target[arm])
        if state is None:
            raise UserError(self._missing(arm))
        return state

    def _missing(self, arm: str) -> str:
        """Say that an arm has told nothing, and what came to its port instead."""
        came, axes = self.reception(arm), len(self.rules.lower)
        look = arm, self.config.ports[arm], self.config.host, Reception(), came, 0.0
        instead = None if came.silent else complaint(*look, axes=axes)
        return instead or f"no feedback came from {title(arm)} yet; check that EGM is set up to send to this machine"

    def state(self) -> ControllerState:
        """Return the controller's state, asked for now."""
        return self._program.state()

    def stopped(self) -> str | None:
        return self._blocks.stop_reason() or self._reason or (ENDED if self._dead() else None)

    def follow(self, arm: str, trajectory: Trajectory) -> int:
        try:
            allowed = check_trajectory(
                self.rules,
                arm,
                trajectory,
                commanded=self.arm(arm).commanded,
                others={other: self.arm(other).commanded for other in self.arms if other != arm},
                clearance=self._clearance,
            )
            self._motions += 1
            if not self.config.motion:
                return self._motions
            problem = self._ask("follow", arm, allowed.times, allowed.joints, self._motions)
            if problem is not None:
                raise Rejected(problem)
        except Rejected:
            self._rejected += 1
            raise
        return self._motions

    def halt(self, arm: str) -> None:
        self._ask("halt", arm)

    def interrupt(self) -> None:
        self._blocks.interrupted.value = True

    def grip(self, arm: str, opening: float, force: float = 10.0) -> None:
        if self.stopped() is not None:
            raise Rejected(f"{arm}: stopped ({self.stopped()})")
        if not self.config.motion:
            return
        if not self._enabled:
            raise Rejected(f"{arm}: the robot was not started")
        if not (np.isfinite(opening) and np.isfinite(force)):
            raise Rejected(f"{arm}: the gripper's target is not a number")
        self._target[arm] = opening
        self._program.grip(arm, opening, force)

    def stop(self, reason: str) -> str:
        try:
            self._ask("stop", reason)
        except UserError:  # no setpoint flows: all the more must the program on the controller be stopped
            self._reason = self._reason or reason
        if self._answering:
            self._stop_program()
        return self._aftermath()

    def unconfirmed(self) -> str | None:
        """Return that the robot's program has not confirmed its stop, and what to do; None if it has, or never began."""
        return UNCONFIRMED if self._unconfirmed else None

    def _aftermath(self) -> str:
        """Return what must be added to the reason of a stop."""
        said = None
        if self._answering:
            with contextlib.suppress(UserError):
                said = self._program.complaint()
        return "; ".join(filter(None, [self.unconfirmed(), said and f"the controller says '{said}'"]))

    def _ramp_out(self) -> None:
        """End guided motion as the robot's program does it: smoothly, while the arms are still held."""
        self._program.end_guided_motion()
        if self._simulated is None:
            time.sleep(self._timing.ramp)

    def _stop_program(self) -> None:
        """Stop the robot's program, and wait for a moment until that is confirmed; it is tried on until `close` returns."""
        self._program.stop()
        self._unconfirmed = True
        self._unconfirmed = not self._program.stopped(self._timing.confirm)

    def _dead(self) -> bool:
        return not self._closing.is_set() and not self._process.is_alive()

    def _stop_if_dead(self) -> None:
        if self._enabled and self._reason is None and self._dead():
            self.stop(ENDED)

    def counters(self) -> Counters:
        """Return what was counted; the last known numbers if the link process died while it wrote them."""
        with contextlib.suppress(UserError):
            self._counted = [int(count) for count in self._blocks.counters.read()]
        return Counters(**dict(zip(COUNTERS, self._counted, strict=True)), rejected=self._rejected)

    def late_rounds(self) -> list[LateRound]:
        """Return when the link process was late recently; a message may have waited meanwhile."""
        return self._blocks.loop_timer.read()

    def drain(self) -> Records:
        """Return the records since the last call."""
        rows, self._drained = self._blocks.records(self._drained)
        return rows

    def _ask(self, *message: object) -> str | None:
        """Return what the process objects to, None if it does as it was told. Raise UserError if it does not answer;
        the robot's program is stopped then."""
        with self._pipe_lock:
            try:
                if not self._hangs:
                    self._pipe.send(message)
                    if self._pipe.poll(self._timing.startup if self._simulated is not None else self._timing.answer):
                        return self._pipe.recv()
            except (OSError, EOFError) as error:
                raise UserError(f"{ENDED}; start again") from error
        if not self._hangs:
            self._hangs, self._reason = True, self._reason or HANGS
            if self._answering:
                self._stop_program()
        raise UserError(f"{HANGS}; start again")


def _address(host: str) -> str:
    """Return the IPv4 address of a host. Raise UserError if it is unknown."""
    try:
        return socket.gethostbyname(host)
    except OSError as error:
        raise UserError(f"the controller {host} is unknown ({error}); give its address with --robot") from error
