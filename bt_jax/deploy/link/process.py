"""The process that talks to the controller: it answers every EGM message of both arms within the cycle, whatever the
program above does, and owns the supervisor. Commands come through a pipe, states go out through shared memory."""

from __future__ import annotations

import dataclasses
import selectors
import socket
import time
from collections.abc import Callable
from multiprocessing.connection import Connection

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import CYCLE, Feedback, Setpoint
from bt_jax.deploy.link.realtime import take_priority
from bt_jax.deploy.link.reception import Receiver, open_socket
from bt_jax.deploy.link.safety import Rules, Supervisor
from bt_jax.deploy.link.settings import LinkTiming
from bt_jax.deploy.link.shared_state import MotionState, SharedState
from bt_jax.deploy.planning.trajectory import Follower, Trajectory
from bt_jax.deploy.robot.arrays import JointRows, Joints

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
class _ArmSession:
    socket: socket.socket
    receiver: Receiver = dataclasses.field(default_factory=Receiver)
    feedback: Feedback | None = None
    address: tuple | None = None
    commanded: Joints | None = None
    velocity: Joints = dataclasses.field(default_factory=lambda: np.zeros(7))
    follower: Follower | None = None
    motion: int = 0
    answers: int = 0


def serve(start: LinkStart, blocks: SharedState, pipe: Connection) -> None:
    """Run until the program above says so, or is gone."""
    take_priority(realtime=start.realtime)
    try:
        arms = {arm: _ArmSession(open_socket(port)) for arm, port in start.ports.items()}
    except OSError as error:
        pipe.send(("failed", f"{error.strerror or error}: {error}"))
        return
    loop = _LinkLoop(start, blocks, pipe, arms)
    pipe.send(("ready", None))
    try:
        loop.run()
    finally:
        for arm in arms.values():
            arm.socket.close()


class _LinkLoop:
    def __init__(self, start: LinkStart, blocks: SharedState, pipe: Connection, arms: dict[str, _ArmSession]) -> None:
        self.start, self.blocks, self.pipe, self.arms = start, blocks, pipe, arms
        self.supervisor = Supervisor(start.rules, tuple(arms))
        self.answering = False  # a person has agreed to motion; until `enabled`, the arms hold where they were then
        self.enabled = False  # the robot was started and must be running from now on
        self.closing = False
        self.cycles = self.missed = self.late = 0
        self.told: str | None = None
        self.requests: dict[str, Callable[..., str | None]] = {
            "follow": self.follow,
            "halt": self.halt,
            "stop": self.stop,
            "answer": self.begin_answering,
            "enable": self.enable,
            "disable": self.disable,
            "close": self.close,
        }

    def run(self) -> None:
        selector = selectors.DefaultSelector()
        for name, arm in self.arms.items():
            selector.register(arm.socket, selectors.EVENT_READ, name)
        selector.register(self.pipe, selectors.EVENT_READ, None)
        parted, watch, timing = None, self.blocks.watch, self.start.timing
        deadline = time.monotonic() + timing.idle
        while not self.closing:
            ready = selector.select(max(0.0, deadline - time.monotonic()))
            began = time.monotonic()
            watch.begin(began - deadline)
            for key, _ in ready:
                if key.data is not None:
                    self.receive(key.data)
                    watch.done("messages")
                elif not self.command():
                    selector.unregister(self.pipe)
                    parted = time.monotonic()
                    self.supervisor.stop("the program above is gone")
            watch.done("commands")
            now = time.monotonic()
            if self.enabled and self.start.realtime:
                moving = any(arm.follower is not None for arm in self.arms.values())
                self.supervisor.watch(now, self.blocks.alive.value, moving=moving)
            self.tell()
            watch.done("supervision")
            deadline = began + timing.idle
            watch.end(deadline)
            if parted is not None and now - parted > timing.parting:
                return

    def tell(self) -> None:
        """Publish a stop that was latched."""
        if self.supervisor.reason is not None and self.supervisor.reason != self.told:
            self.told = self.supervisor.reason
            self.blocks.tell_stop(self.told)

    def receive(self, name: str) -> None:
        """Take all messages that wait, and answer the newest."""
        arm, count, heard = self.arms[name], 0, False
        newest: Feedback | None = None
        while True:
            try:
                data, address = arm.socket.recvfrom(4096)
            except (BlockingIOError, ConnectionError):
                break
            heard = True
            if address[0] != self.start.host:
                arm.receiver.drop_foreign(address[0])
                continue
            try:
                feedback = Feedback.decode(data, len(self.start.rules.lower))
            except ValueError as problem:  # like a lost one: where nothing else comes, the silence stops the robot
                arm.receiver.drop_invalid(problem)
                continue
            before = arm.feedback
            if not self.supervisor.accept(name, feedback, time.monotonic(), moving_allowed=self.enabled):
                arm.receiver.drop_old()
                continue
            arm.receiver.take(address, feedback.sequence, feedback.time)
            if before is not None and feedback.time > before.time:
                arm.velocity = (feedback.joints - before.joints) / (feedback.time - before.time)
            arm.feedback, arm.address, newest = feedback, address, feedback
            count += 1
        self.late += max(count - 1, 0)
        if heard:
            self.blocks.receptions[name].write(arm.receiver.reception.numbers())
        if newest is not None:
            self.answer(name, arm, newest)

    def answer(self, name: str, arm: _ArmSession, feedback: Feedback) -> None:
        """Send the arm's next setpoint, checked by the supervisor."""
        self.cycles += 1
        if arm.commanded is None or not self.answering:
            arm.commanded = feedback.joints.copy()
        if arm.follower is not None and not self.enabled:
            arm.follower = None
        if self.blocks.interrupted.value and arm.follower is not None:
            arm.follower.halt()
        target = arm.commanded if arm.follower is None else arm.follower.advance(CYCLE)
        if self.enabled:
            arm.commanded = self.supervisor.admit(name, target, commanded=arm.commanded, measured=feedback.joints)
            setpoints = {n: a.commanded for n, a in self.arms.items() if a.commanded is not None}
            self.supervisor.keep_clear(setpoints, moving=arm.follower is not None)
        if self.supervisor.reason is not None or (arm.follower is not None and arm.follower.done):
            arm.follower = None
        self.publish(name, arm, feedback, arm.commanded)
        self.blocks.record(name, feedback, arm.commanded)
        if self.answering and arm.address is not None and np.all(np.isfinite(arm.commanded)):
            arm.answers += 1
            message = Setpoint(arm.answers, feedback.time, arm.commanded).encode()
            try:
                arm.socket.sendto(message, arm.address)
            except OSError:
                self.missed += 1

    def publish(self, name: str, arm: _ArmSession, feedback: Feedback, commanded: Joints) -> None:
        """Write the state that the program above reads."""
        motion = MotionState(
            arm.follower is not None, arm.motion, 0.0 if arm.follower is None else arm.follower.remaining
        )
        self.blocks.write_arm(name, feedback, arm.velocity, commanded, motion)
        supervisor = self.supervisor
        counters = (self.cycles, self.missed, self.late, supervisor.lost, supervisor.reordered, supervisor.clipped)
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
        arm = self.arms[name]
        trajectory = Trajectory(times, joints)
        if self.supervisor.reason is not None:
            return f"{name}: stopped ({self.supervisor.reason})"
        if self.blocks.interrupted.value:
            return f"{name}: interrupted"
        if not self.enabled or arm.commanded is None or arm.feedback is None:
            return f"{name}: the robot was not started"
        if not np.max(np.abs(joints[0] - arm.commanded)) <= self.start.rules.start:
            return f"{name}: the path begins elsewhere than the arm is by now"
        arm.follower, arm.motion = Follower(trajectory), motion
        self.blocks.alive.value = time.monotonic()
        self.publish(name, arm, arm.feedback, arm.commanded)
        return None

    def halt(self, name: str) -> None:
        follower = self.arms[name].follower
        if follower is not None:
            follower.halt()

    def stop(self, reason: str) -> None:
        self.supervisor.stop(reason)
        self.tell()  # before the answer: who asks afterwards finds the reason

    def fresh(self, name: str, arm: _ArmSession) -> bool:
        """Does the arm send feedback now? Between its first feedback and guided motion, the robot is silent for a while."""
        if arm.feedback is None or not self.start.realtime:
            return arm.feedback is not None
        return self.supervisor.silence(name, time.monotonic()) < self.start.rules.stale / 2

    def begin_answering(self) -> str | None:
        """Send setpoints from now on: the arms hold where the next message finds them."""
        if not self.start.motion:
            return "this link only listens"
        if not self.answering:
            for arm in self.arms.values():
                arm.commanded = None
            self.answering = True
        return None

    def enable(self) -> str | None:
        """Require from now on that the robot is running and the executor shows that it is alive."""
        silent = [
            name
            for name, arm in self.arms.items()
            if arm.feedback is None or not self.fresh(name, arm) or not arm.feedback.running
        ]
        if silent:
            return f"{' and '.join(silent)}: not running"
        for name, arm in self.arms.items():
            if (
                arm.commanded is None
                or arm.feedback is None
                or not np.max(np.abs(arm.feedback.joints - arm.commanded)) <= self.start.rules.start
            ):
                return f"{name}: not where it was when the start was asked for"
        self.blocks.alive.value = time.monotonic()
        self.enabled = True
        return None

    def disable(self) -> None:
        """Hold the arms; the robot may end its guided motion."""
        self.enabled = False

    def close(self) -> None:
        self.closing = True
