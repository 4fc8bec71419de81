"""What each message of the controller is answered with. No socket, no process and no clock of its own: time is told.

Before the start nothing is answered. Then the arms hold where they were first measured, follow paths, pause, and come to
rest; every setpoint is one step of a `SetpointStream` and every cycle is supervised.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from jaxtyping import Float

from bt_jax.deploy.link.egm import Feedback
from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.link.setpoints import ElapsedTime, SetpointStream
from bt_jax.deploy.link.supervision import Supervisor
from bt_jax.deploy.planning.trajectory import HALT, Follower, Trajectory
from bt_jax.deploy.robot.arrays import JointRows, Joints

__all__ = ["Guidance", "GuidedArm"]

MEASUREMENTS = 3  # that must agree for the first setpoint
BRAKED = 0.5  # share of the accelerations that slowing down on a path may take; the path itself takes the rest


@dataclasses.dataclass
class GuidedArm:
    """One arm: what it said last, and what it is sent."""

    elapsed: ElapsedTime
    seconds: float = 0.0  # by which its setpoint is still to move on for its newest message
    feedback: Feedback | None = None
    velocity: Joints | None = None  # as measured, rad/s
    measurements: list[Joints] = dataclasses.field(default_factory=list)  # that agree, until there is a first setpoint
    setpoints: SetpointStream | None = None
    follower: Follower | None = None
    motion: int = 0  # number of the path that was accepted last

    @property
    def commanded(self) -> Joints | None:
        """The last setpoint; the measured joints while none was sent."""
        if self.setpoints is not None:
            return self.setpoints.joints
        return None if self.feedback is None else self.feedback.joints

    @property
    def moving(self) -> bool:
        """Does it follow a path, or come to rest?"""
        return self.follower is not None or not (self.setpoints is None or self.setpoints.resting)

    def take_seconds(self) -> float:
        """Return the seconds that are still to be moved on, once."""
        seconds, self.seconds = self.seconds, 0.0
        return seconds


class Guidance:
    """The arms of a robot. `realtime`: its clock is ours; else it waits for our answers."""

    def __init__(self, rules: Rules, arms: tuple[str, ...], *, realtime: bool) -> None:
        self.rules, self.realtime = rules, realtime
        self.supervisor = Supervisor(rules, arms)
        self.arms = {arm: GuidedArm(ElapsedTime(rules.longest)) for arm in arms}
        self.answering = False  # a person has agreed to motion; until `enabled`, the arms hold where they were then
        self.enabled = False  # the robot was started and must be running from now on
        self.interrupted = False  # all arms come to rest, for good
        self.paused = False  # the program above shows no sign of life
        self.clipped = 0  # setpoints that could not be where the path was
        self._measured_next = False

    def hear(self, name: str, feedback: Feedback, now: float) -> bool:
        """Take a message at the time `now` [s]; return False if it must be ignored."""
        if not self.supervisor.accept(name, feedback, now, moving_allowed=self.enabled):
            return False
        arm, before = self.arms[name], self.arms[name].feedback
        if before is not None and feedback.time > before.time:
            with np.errstate(invalid="ignore"):  # of what is not finite, which stops the arm
                arm.velocity = (feedback.joints - before.joints) / (feedback.time - before.time)
        arm.feedback = feedback
        if self.answering and arm.setpoints is None:
            self._measure(arm, feedback.joints)
        return True

    def answer(self, name: str, now: float) -> Joints | None:
        """Return the setpoint that answers an arm's newest message, None if it is not to be answered."""
        arm = self.arms[name]
        assert arm.feedback is not None
        feedback = arm.feedback
        arm.seconds = arm.elapsed.since_last(feedback.time, now if self.realtime else feedback.time, feedback.stamp)
        if not self.answering or arm.setpoints is None:
            return None
        if self.enabled and arm.moving:
            self._look_around()
        if self.enabled:
            self.supervisor.keep_up(name, arm.setpoints.off(arm.feedback.joints))
        if self.supervisor.braking:
            arm.follower = None
        if arm.follower is not None:
            return self._follow(name, arm, arm.follower, arm.setpoints)
        return arm.setpoints.brake(arm.take_seconds())

    def recover(self, name: str, error: Exception) -> Joints | None:
        """Latch a stop after an error in `answer`, and return what is to be sent instead."""
        self.supervisor.stop(f"{name}: the link failed ({type(error).__name__}: {error})", brake=True)
        arm = self.arms[name]
        arm.follower = None
        return None if arm.setpoints is None else arm.setpoints.brake(arm.take_seconds())

    def watch(self, now: float, alive: float) -> None:
        """Stop where an arm is silent. Where the last sign of life [s] is old, pause; stop where it is too old."""
        if self.enabled and self.realtime:
            self.supervisor.watch(now, alive, moving=any(arm.moving for arm in self.arms.values()))
            self.paused = not now - alive <= self.rules.pause

    def follow(self, name: str, times: Float[np.ndarray, " n"], joints: JointRows, motion: int) -> str | None:
        """Begin a path; return what prevents it."""
        arm = self.arms[name]
        trajectory = Trajectory(times, joints)
        if self.supervisor.reason is not None:
            return f"{name}: stopped ({self.supervisor.reason})"
        if self.interrupted:
            return f"{name}: interrupted"
        if not self.enabled or arm.setpoints is None:
            return f"{name}: the robot was not started"
        if joints.shape[1] != len(arm.setpoints.joints):
            return f"{name}: the path is of {joints.shape[1]} joints, the arm has {len(arm.setpoints.joints)}"
        if not arm.setpoints.resting:
            return f"{name}: the arm still moves; halt it before the next path"
        if not np.max(np.abs(joints[0] - arm.setpoints.joints)) <= self.rules.start:
            return f"{name}: the path begins elsewhere than the arm is by now"
        self.supervisor.begin_path(self._resting())
        braking = np.abs(trajectory.speeds()).max(axis=0, initial=0.0) / self.rules.acceleration
        arm.follower, arm.motion = Follower(trajectory, ramp=max(HALT, float(braking.max()) / BRAKED)), motion
        return None

    def halt(self, name: str) -> None:
        """Bring an arm to rest on its path."""
        follower = self.arms[name].follower
        if follower is not None:
            follower.halt()

    def begin_answering(self) -> None:
        """Send setpoints from now on, first of all where each arm is."""
        if not self.answering:
            for arm in self.arms.values():
                arm.setpoints, arm.measurements = None, []
            self.answering = True

    def enable(self, now: float) -> str | None:
        """Require from now on that the robot is running and the executor shows that it is alive."""
        silent = [name for name, arm in self.arms.items() if not self._ready(name, arm, now)]
        if silent:
            return f"{' and '.join(silent)}: not running"
        for name, arm in self.arms.items():
            if arm.setpoints is None or arm.feedback is None:
                return f"{name}: {MEASUREMENTS} messages that agree on where it is did not come"
            if not np.max(np.abs(arm.feedback.joints - arm.setpoints.joints)) <= self.rules.moved:
                return f"{name}: not where it was when the start was asked for"
        self.enabled = True
        return None

    def disable(self) -> None:
        """Bring the arms to rest and hold them; the robot may end its guided motion."""
        self.enabled = False
        for name in self.arms:
            self.halt(name)

    def _measure(self, arm: GuidedArm, joints: Joints) -> None:
        """Make the first setpoint of measurements in a row that agree and are possible."""
        room = self.rules.implausible
        lower, upper = np.array(self.rules.lower) - room, np.array(self.rules.upper) + room
        if not (np.all(joints >= lower) and np.all(joints <= upper)):
            arm.measurements = []
            return
        if not all(np.abs(joints - before).max() <= self.rules.agreement for before in arm.measurements):
            arm.measurements = []
        arm.measurements.append(joints)
        if len(arm.measurements) == MEASUREMENTS:
            arm.setpoints = SetpointStream(self.rules, joints)

    def _follow(self, name: str, arm: GuidedArm, follower: Follower, setpoints: SetpointStream) -> Joints:
        if self.interrupted or self.supervisor.reason is not None:
            follower.halt()
        follower.paused = self.paused
        target = follower.advance(arm.seconds)
        if not self.supervisor.permits(name, target, before=setpoints.joints):
            arm.follower = None
            return setpoints.brake(arm.take_seconds())
        joints = setpoints.track(target, arm.take_seconds())
        left = float(np.abs(joints - target).max())
        self.clipped += left > 1e-9
        if not left <= self.rules.deviation:
            self.supervisor.stop(f"{name}: the path asks for more than the arm's speeds and accelerations", brake=True)
        if follower.done and left <= 1e-9:
            arm.follower = None
        return joints

    def _look_around(self) -> None:
        """Stop arms that would be too near to something if they braked now, or are measured there. That costs most of a
        cycle's time: each message asks for one of the two."""
        self._measured_next = not self._measured_next
        if self._measured_next:
            measured = {name: arm.feedback.joints for name, arm in self.arms.items() if arm.feedback is not None}
            self.supervisor.keep_clear(measured, "measured joints")
        else:
            self.supervisor.keep_clear(self._resting(), "setpoints")

    def _resting(self) -> dict[str, Joints]:
        """Return where each arm would come to rest if it braked now."""
        return {name: arm.setpoints.rest() for name, arm in self.arms.items() if arm.setpoints is not None}

    def _ready(self, name: str, arm: GuidedArm, now: float) -> bool:
        """Does the arm send feedback now, and would move? Between its first feedback and guided motion, the robot is silent
        for a while."""
        if arm.feedback is None or not arm.feedback.running:
            return False
        return not self.realtime or self.supervisor.silence(name, now) < self.rules.stale / 2
