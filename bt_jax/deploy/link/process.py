"""The process that talks to the controller: it answers every EGM message of all arms within the cycle, whatever the program
above does. What it answers is decided in `guidance`; commands come through a pipe, states go out through shared memory."""

from __future__ import annotations

import dataclasses
import selectors
import socket
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import Feedback, Setpoint
from bt_jax.deploy.link.guidance import Guidance
from bt_jax.deploy.link.realtime import take_priority
from bt_jax.deploy.link.reception import Receiver, open_socket
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.link.settings import LinkTiming
from bt_jax.deploy.link.shared_state import MotionState, SharedState
from bt_jax.deploy.robot.arrays import JointRows

__all__ = ["LinkStart", "serve"]


@dataclasses.dataclass(frozen=True)
class LinkStart:
    """What the process needs to begin."""

    host: str  # IPv4 address of the controller; what comes from elsewhere is dropped
    ports: dict[str, int]
    rules: Rules
    realtime: bool  # the robot's clock is ours; False: it waits for our answers and stands still in between
    motion: bool  # False: listen and never answer
    timing: LinkTiming


@dataclasses.dataclass
class _Session:
    """The connection of one arm."""

    socket: socket.socket
    receiver: Receiver = dataclasses.field(default_factory=Receiver)
    address: tuple | None = None
    answers: int = 0


def serve(start: LinkStart, blocks: SharedState, pipe: Connection) -> None:
    """Run until the program above says so, or is gone."""
    take_priority(realtime=start.realtime)
    try:
        sessions = {arm: _Session(open_socket(port)) for arm, port in start.ports.items()}
    except OSError as error:
        pipe.send(("failed", f"{error.strerror or error}: {error}"))
        return
    loop = _LinkLoop(start, blocks, pipe, sessions)
    pipe.send(("ready", None))
    try:
        loop.run()
    finally:
        for session in sessions.values():
            session.socket.close()


class _LinkLoop:
    def __init__(self, start: LinkStart, blocks: SharedState, pipe: Connection, sessions: dict[str, _Session]) -> None:
        self.start, self.blocks, self.pipe, self.sessions = start, blocks, pipe, sessions
        self.guidance = Guidance(start.rules, tuple(sessions), realtime=start.realtime)
        self.closing = False
        self.cycles = self.missed = self.late = 0
        self.told: str | None = None
        self.requests: dict[str, Callable[..., str | None]] = {
            "follow": self.follow,
            "halt": self.guidance.halt,
            "stop": self.stop,
            "answer": self.begin_answering,
            "enable": self.enable,
            "disable": self.guidance.disable,
            "close": self.close,
        }

    def run(self) -> None:
        selector = selectors.DefaultSelector()
        for name, session in self.sessions.items():
            selector.register(session.socket, selectors.EVENT_READ, name)
        selector.register(self.pipe, selectors.EVENT_READ, None)
        parted, timer, timing = None, self.blocks.loop_timer, self.start.timing
        deadline = time.monotonic() + timing.idle
        while not self.closing:
            ready = selector.select(max(0.0, deadline - time.monotonic()))
            began = time.monotonic()
            timer.begin(began - deadline)
            for key, _ in ready:
                if key.data is not None:
                    try:
                        self.receive(key.data)
                    except Exception as error:  # the other arm is answered all the same
                        self.fail(error)
                    timer.done("messages")
                elif not self.command():
                    selector.unregister(self.pipe)
                    parted = time.monotonic()
                    self.guidance.supervisor.stop("the program above is gone")
            timer.done("commands")
            now = time.monotonic()
            try:
                self.guidance.watch(now, self.blocks.alive.value)
            except Exception as error:
                self.fail(error)
            self.tell()
            timer.done("supervision")
            deadline = began + timing.idle
            timer.end(deadline)
            if parted is not None and now - parted > timing.parting:
                return

    def fail(self, error: Exception) -> None:
        """Latch a stop after an error in a cycle: the process goes on, and with it the setpoints."""
        self.guidance.supervisor.stop(f"the link process failed ({type(error).__name__}: {error})")

    def tell(self) -> None:
        """Publish a stop that was latched."""
        reason = self.guidance.supervisor.reason
        if reason is not None and reason != self.told:
            self.told = reason
            self.blocks.tell_stop(reason)

    def receive(self, name: str) -> None:
        """Take all messages that wait, and answer the newest."""
        session, count, heard = self.sessions[name], 0, False
        while True:
            try:
                data, address = session.socket.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                break
            heard = True
            if address[0] != self.start.host:
                session.receiver.drop_foreign(address[0])
                continue
            try:
                feedback = Feedback.decode(data, len(self.start.rules.lower))
            except ValueError as problem:  # like a lost one: where nothing else comes, the silence stops the robot
                session.receiver.drop_invalid(problem)
                continue
            if not self.guidance.hear(name, feedback, time.monotonic()):
                session.receiver.drop_old()
                continue
            session.receiver.take(address, feedback.sequence, feedback.time)
            session.address = address
            count += 1
        self.late += max(count - 1, 0)
        if heard:
            self.blocks.receptions[name].write(session.receiver.reception.numbers())
        if count:
            self.answer(name, session)

    def answer(self, name: str, session: _Session) -> None:
        """Send the arm's next setpoint. An error in what decides it stops the robot; the arm is braked all the same."""
        self.cycles += 1
        self.guidance.interrupted = bool(self.blocks.interrupted.value)
        try:
            setpoint = self.guidance.answer(name, time.monotonic())
        except Exception as error:
            setpoint = self.guidance.recover(name, error)
        feedback = self.guidance.arms[name].feedback
        if (
            setpoint is not None
            and feedback is not None
            and session.address is not None
            and np.isfinite(setpoint).all()
        ):
            session.answers += 1
            try:
                session.socket.sendto(Setpoint(session.answers, feedback.time, setpoint).encode(), session.address)
            except OSError:
                self.missed += 1
        self.publish(name)
        if feedback is not None:
            self.blocks.record(name, feedback, feedback.joints if setpoint is None else setpoint)

    def publish(self, name: str) -> None:
        """Write the state that the program above reads."""
        arm, supervisor = self.guidance.arms[name], self.guidance.supervisor
        if arm.feedback is not None and arm.commanded is not None:
            motion = MotionState(arm.moving, arm.motion, 0.0 if arm.follower is None else arm.follower.remaining)
            velocity = np.zeros_like(arm.commanded) if arm.velocity is None else arm.velocity
            self.blocks.write_arm(name, arm.feedback, velocity, arm.commanded, motion)
        counters = (self.cycles, self.missed, self.late, supervisor.lost, supervisor.reordered, self.guidance.clipped)
        self.blocks.counters.write(np.array(counters, float))

    def command(self) -> bool:
        """Do what the program above asks for and answer with what prevented it, None if nothing did; return False if that
        program is gone. A request that raises stops the robot; its setpoints go on."""
        try:
            message = self.pipe.recv()
        except (EOFError, OSError):
            return False
        try:
            name, *arguments = message
            problem = self.requests[name](*arguments)
        except Exception as error:
            problem = f"the link process failed to do as asked ({type(error).__name__}: {error})"
            self.stop(problem)
        try:
            self.pipe.send(problem)
        except OSError:
            return False
        return True

    def follow(self, name: str, times: Float[np.ndarray, " n"], joints: JointRows, motion: int) -> str | None:
        self.guidance.interrupted = bool(self.blocks.interrupted.value)
        problem = self.guidance.follow(name, times, joints, motion)
        if problem is None:
            self.blocks.alive.value = time.monotonic()
            self.publish(name)
        return problem

    def stop(self, reason: str) -> None:
        self.guidance.supervisor.stop(reason)
        self.tell()  # before the answer: who asks afterwards finds the reason

    def begin_answering(self) -> str | None:
        if not self.start.motion:
            return "this link only listens"
        self.guidance.begin_answering()
        return None

    def enable(self) -> str | None:
        problem = self.guidance.enable(time.monotonic())
        if problem is None:
            self.blocks.alive.value = time.monotonic()
        return problem

    def close(self) -> None:
        self.closing = True
