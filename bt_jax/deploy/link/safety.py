"""What stands between any program above and the arms: every setpoint is checked, every doubt ends in a hold.

Targets that break a rule are rejected as a whole; only steps are clipped. What goes wrong while the robot runs (silence,
lost messages, another state, a setpoint out of bounds, an arm that does not follow) latches a stop: the arms hold where
they were measured until a person starts the program again. This is software: it replaces neither the emergency stop nor
a risk assessment.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from bt_jax.deploy.link.egm import CYCLE, Feedback
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.robot.arrays import Joints, Point

__all__ = ["Clearance", "Points", "Rejected", "Rules", "Supervisor", "check_setpoint", "check_trajectory"]

Points = Callable[[str, Joints], Mapping[str, Point]]
"""points(arm, joints [7]) -> {"tcp": xyz, "elbow": xyz, ...} in the robot's base frame [m]."""
Clearance = Callable[[Mapping[str, Joints]], float]
"""clearance({arm: joints [7]}) of all arms -> smallest distance [m] between the arms, and to tables and fixtures."""

SEEN_EVERY = 0.02  # seconds of a trajectory between two looks at clearance
SLACK = 1e-9


class Rejected(Exception):
    """A target that must not be approached; the message says which rule it breaks."""


@dataclasses.dataclass(frozen=True)
class Rules:
    """What is allowed. Joint bounds [rad] and speeds [rad/s] are [7] in chain order, the same for both arms."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]
    speed: tuple[float, ...]  # of the robot: faster targets are rejected
    margin: float = np.radians(2.0)  # distance kept from the joint bounds
    override: float = np.inf  # rad/s: slower than the robot could; trajectories are slowed down to it
    start: float = 0.02  # rad between where an arm is sent and where a new path begins
    lag: float = 0.25  # rad between setpoint and measurement: something blocks the arm
    lowest: tuple[float, float, float] = (-0.2, -0.8, 0.0)  # workspace of the points, base frame [m]
    highest: tuple[float, float, float] = (0.8, 0.8, 1.2)
    clearance: float = 0.005  # m
    stale: float = 0.1  # seconds without feedback
    gap: int = 10  # messages lost in a row
    overrun: float = 2.0  # seconds without a sign of life from the executor while an arm moves
    idle: float = 5.0  # the same while the arms rest: nothing is urgent, and a first look takes time
    points: Points | None = None
    clearance_of: Callable[[], Clearance] | None = None  # called once in each process that checks

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, float | tuple) and np.isnan(value).any():
                raise ValueError(f"the rule '{name}' is not a number, and would allow everything")


def check_setpoint(rules: Rules, arm: str, joints: Joints) -> None:
    """Raise Rejected if one configuration [7] breaks a rule that needs neither history nor the other arm."""
    if not np.all(np.isfinite(joints)):
        raise Rejected(f"{arm}: a joint is not a number")
    lower, upper = np.array(rules.lower) + rules.margin, np.array(rules.upper) - rules.margin
    beyond = np.maximum(lower - joints, joints - upper)
    worst = int(np.argmax(beyond))
    if not beyond[worst] <= SLACK:
        raise Rejected(
            f"{arm}: joint {worst + 1} of the chain at {np.degrees(joints[worst]):.1f} deg is beyond "
            f"{np.degrees(lower[worst]):.1f} .. {np.degrees(upper[worst]):.1f} deg"
        )
    if rules.points is None:
        return
    for name, point in rules.points(arm, joints).items():
        if not (np.all(point >= rules.lowest) and np.all(point <= rules.highest)):
            raise Rejected(f"{arm}: {name} at ({', '.join(f'{x:.3f}' for x in point)}) m is outside the workspace")


def check_trajectory(
    rules: Rules,
    arm: str,
    trajectory: Trajectory,
    *,
    commanded: Joints,
    others: Mapping[str, Joints],
    clearance: Clearance | None,
) -> Trajectory:
    """Return the trajectory as it may run, slowed down to `rules.override`.

    `commanded` [7] is where the arm is sent now, `others` where each other arm is. Raise Rejected if any point
    breaks a rule: it is not entered, not even in part.
    """
    if trajectory.joints.shape[1] != len(commanded):
        raise Rejected(f"{arm}: the path is of {trajectory.joints.shape[1]} joints, the arm has {len(commanded)}")
    if not np.all(np.isfinite(trajectory.joints)) or not np.all(np.isfinite(trajectory.times)):
        raise Rejected(f"{arm}: a joint is not a number")
    away = float(np.max(np.abs(trajectory.joints[0] - commanded)))
    if not away <= rules.start:
        raise Rejected(f"{arm}: the path begins {np.degrees(away):.1f} deg away from where the arm is")
    speeds = np.abs(trajectory.speeds())
    if not np.all(speeds <= np.array(rules.speed) * (1 + 1e-6)):
        worst = int(np.argmax((speeds / rules.speed).max(axis=0)))
        raise Rejected(f"{arm}: joint {worst + 1} of the chain would turn at {speeds[:, worst].max():.2f} rad/s")
    for joints in trajectory.joints[1:]:
        check_setpoint(rules, arm, joints)
    if clearance is not None:
        for time in np.append(np.arange(SEEN_EVERY, trajectory.duration, SEEN_EVERY), trajectory.duration):
            distance = clearance({**others, arm: trajectory.at(time)})
            if not distance >= rules.clearance:
                raise Rejected(f"{arm}: the path comes as near as {1000 * distance:.0f} mm, {time:.2f} s on its way")
    return trajectory.slowed(max(1.0, float(speeds.max(initial=0.0)) / rules.override))


class Supervisor:
    """Watches one cycle after the other; knows no clock and no socket, so that every fault can be tried on it.

    `reason` is None until something goes wrong, then says what, for good.
    """

    def __init__(self, rules: Rules, arms: tuple[str, ...]) -> None:
        self.rules, self.arms = rules, arms
        self.reason: str | None = None
        self.lost = self.reordered = self.clipped = 0
        self._sequence: dict[str, int] = {}
        self._heard: dict[str, float] = {}
        self._hold: dict[str, Joints] = {}  # where each arm was measured when the stop was latched
        self._clearance = rules.clearance_of() if rules.clearance_of is not None else None

    def stop(self, reason: str) -> None:
        """Latch a stop; the first reason stays."""
        self.reason = self.reason or reason

    def accept(self, arm: str, feedback: Feedback, now: float, *, moving_allowed: bool) -> bool:
        """Take a message at the time `now` [s]; return False if it is older than one before and must be ignored."""
        last = self._sequence.get(arm)
        if last is not None:
            ahead = (feedback.sequence - last + (1 << 31)) % (1 << 32) - (1 << 31)
            if ahead <= 0 and (moving_allowed or ahead > -self.rules.gap):
                self.reordered += 1
                return False
            ahead = max(ahead, 1)  # a new session: its numbers begin again
            self.lost += ahead - 1
            if ahead - 1 > self.rules.gap and moving_allowed:
                self.stop(f"{arm}: {ahead - 1} messages of the controller were lost in a row")
        self._sequence[arm], self._heard[arm] = feedback.sequence, now
        if not np.all(np.isfinite(feedback.joints)):
            self.stop(f"{arm}: the measured joints are not numbers")
        if moving_allowed and not feedback.running:
            self.stop(
                f"{arm}: the controller is not running (motors {'on' if feedback.motors_on else 'off'}, "
                f"EGM {feedback.mci.name.lower()}, RAPID {'running' if feedback.rapid_running else 'stopped'})"
            )
        return True

    def silence(self, arm: str, now: float) -> float:
        """Return the seconds since the last message of an arm; 0 if there was none."""
        return now - self._heard.get(arm, now)

    def watch(self, now: float, alive: float, *, moving: bool) -> None:
        """Latch a stop if an arm is silent, or the executor gave its last sign of life, `alive`, too long ago [s]."""
        for arm in self.arms:
            silence = self.silence(arm, now)
            if not silence <= self.rules.stale:
                self.stop(f"{arm}: no feedback for {silence:.2f} s; the controller or the network is down")
        if not now - alive <= (self.rules.overrun if moving else self.rules.idle):
            self.stop(f"the executor gave no sign of life for {now - alive:.1f} s; a tick takes too long")

    def admit(self, arm: str, target: Joints, *, commanded: Joints, measured: Joints) -> Joints:
        """Return the setpoint to send for a target: itself, or less far from `commanded` where the step is too large. Where
        the target breaks a rule, or the arm lags behind, latches and gives the measured joints; `commanded` where they are
        not known."""
        lag = float(np.max(np.abs(commanded - measured)))
        if not lag <= self.rules.lag:  # also where a joint is not a number
            self.stop(f"{arm}: the arm is {np.degrees(lag):.0f} deg from its setpoint; something holds it")
        else:
            try:
                if not np.array_equal(
                    target, commanded
                ):  # holding is always allowed, also where a start was out of bounds
                    check_setpoint(self.rules, arm, target)
            except Rejected as broken:
                self.stop(str(broken))
        if self.reason is not None:
            return self._hold.setdefault(arm, np.where(np.isfinite(measured), measured, commanded))
        step = np.minimum(self.rules.speed, self.rules.override) * (CYCLE * 1.05)
        clipped = np.clip(target, commanded - step, commanded + step)
        self.clipped += not np.array_equal(clipped, target)
        return clipped

    def keep_clear(self, setpoints: Mapping[str, Joints], *, moving: bool) -> None:
        """Latch a stop if moving arms, as they are sent now, come too near to each other or to anything fixed."""
        if self._clearance is None or not moving or len(setpoints) < len(self.arms):
            return
        distance = self._clearance(setpoints)
        if not distance >= self.rules.clearance:
            self.stop(f"the arms came as near as {1000 * distance:.0f} mm to each other or to a fixture")
