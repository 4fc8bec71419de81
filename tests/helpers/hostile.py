"""A controller and a program above that do what they must not, and a witness of every setpoint that leaves the link."""

import dataclasses

import numpy as np

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.guidance import Guidance
from bt_jax.deploy.link.safety import Rejected, Rules, check_trajectory
from bt_jax.deploy.link.setpoints import ROUNDED, ElapsedTime
from bt_jax.deploy.planning.trajectory import Trajectory
from tests.helpers.cells import smooth

ARMS = ("left", "right")
RULES = Rules(
    lower=(-1.0, -0.8, -1.0, -1.0, -2.0, -1.0, -1.0), upper=(1.0, 1.0, 0.7, 1.0, 2.0, 1.0, 1.0),
    speed=(2.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0), acceleration=(10.0, 10.0, 15.0, 15.0, 25.0, 25.0, 25.0),
    lowest=(-0.2, -0.8, 0.0), highest=(0.8, 0.8, 1.2),
)  # fmt: skip
LOWER, UPPER = np.array(RULES.lower) + RULES.margin, np.array(RULES.upper) - RULES.margin
EPISODE = 400  # cycles


class Witness:
    """Checks every setpoint of one arm against the ones before. How far it may have gone is counted here, by our time alone:
    no message adds to that, whatever the controller's clock says."""

    def __init__(self, arm: str, rules: Rules = RULES) -> None:
        self.arm, self.elapsed = arm, ElapsedTime(rules.longest)  # for how sudden a step may be
        self.speed = np.minimum(rules.speed, rules.override)
        self.room = self.speed * rules.longest  # rad that each joint may go
        self.now: float | None = None
        self.measured: list[np.ndarray] = []
        self.sent: np.ndarray | None = None
        self.velocity = np.zeros(7)
        self.time = 0.0
        self.moved = 0

    def see(self, feedback: Feedback, now: float, sent: np.ndarray | None) -> None:
        seconds = self.elapsed.since_last(feedback.time, now, feedback.stamp)
        assert 0 <= seconds <= min(max(feedback.time - self.time, 0.0) + ROUNDED, RULES.longest)
        passed = 0.0 if self.now is None else now - self.now
        self.room = np.minimum(self.room + self.speed * passed, self.speed * RULES.longest)
        self.time, self.now = feedback.time, now
        self.measured = [*self.measured[-2:], feedback.joints]
        if sent is None:
            assert self.sent is None, "an arm that was answered must not be left alone"
            return
        assert np.isfinite(sent).all()
        if self.sent is None:
            np.testing.assert_array_equal(sent, feedback.joints)
            assert len(self.measured) == 3
            assert np.ptp(self.measured, axis=0).max() <= 2 * RULES.agreement
            assert np.all(sent >= np.array(RULES.lower) - RULES.implausible)
            assert np.all(sent <= np.array(RULES.upper) + RULES.implausible)
            self.sent = sent.copy()
            return
        step = sent - self.sent
        assert np.all(np.abs(step) <= self.speed * seconds + 1e-12), "more than one step"
        self.room = self.room - np.abs(step)
        assert np.all(self.room >= -1e-9), "faster than by our time"
        assert np.all(sent >= np.minimum(LOWER, self.sent) - 1e-12), "out of bounds"
        assert np.all(sent <= np.maximum(UPPER, self.sent) + 1e-12), "out of bounds"
        if seconds > 1e-9:  # else all that a step shows is how numbers are rounded
            velocity = step / seconds
            most = np.array(RULES.acceleration) * seconds
            assert np.all(np.abs(velocity - self.velocity) <= most + 1e-9), "too sudden"
            self.velocity = velocity
            self.moved += bool(np.any(step))
        self.sent = sent.copy()


def hostile_path(rng, start):
    """A path that nobody has checked."""
    count = int(rng.integers(1, 20))
    joints = start + np.cumsum(rng.normal(0, rng.choice([0.001, 0.02, 1.0]), (count, 7)), axis=0)
    joints[0] = start + rng.choice([0.0, 0.004, 0.1])
    if rng.random() < 0.2:
        joints[-1, rng.integers(7)] = rng.choice([np.nan, np.inf, 1e300])
    return Trajectory(np.concatenate([[0.0], np.cumsum(rng.uniform(0.001, 0.1, count - 1))]), joints)


def checked_path(rules, rng, start):
    """A path as the program above asks for one; None if it is rejected."""
    inside = np.clip(rng.uniform(-1.2, 1.2, 7), LOWER, UPPER)
    try:
        path = smooth(start, inside, rng.uniform(0.2, 2.0))
        return check_trajectory(rules, "left", path, commanded=start, others={}, clearance=None)
    except Rejected:
        return None


class Peer:
    """A controller and a program above that do what they should, and with a chance of `evil` what they must not."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.evil = float(rng.choice([0.0, 0.002, 0.02, 0.2]))
        rules = dataclasses.replace(RULES, override=float(rng.choice([np.inf, 1.0, 0.2])))
        if rng.random() < 0.5:
            rules = dataclasses.replace(rules, points=lambda arm, joints: {"tcp": 0.3 * joints[:3] + [0.3, 0.0, 0.5]})
        if rng.random() < 0.2:
            rules = dataclasses.replace(rules, clearance_of=lambda: lambda joints: 0.8 - abs(joints["left"][0]))
        self.guidance = Guidance(rules, ARMS, realtime=True)
        self.rules = rules
        self.witnesses = {arm: Witness(arm, rules) for arm in ARMS}
        where = rng.uniform(-0.5, 0.5, 7) if rng.random() < 0.8 else rng.uniform(LOWER - 0.1, UPPER + 0.1)
        self.joints = {arm: where.copy() for arm in ARMS}
        self.sequence = dict.fromkeys(ARMS, 1)
        self.time = self.now = self.alive = 100.0
        self.period = float(rng.choice([CYCLE, CYCLE, 0.001]))
        self.ahead = float(rng.choice([1.0, 1.0, 1.0, 3.0]))  # how fast the controller's clock runs
        self.stamped = rng.random() < 0.5
        self.blocked = self.quiet = False

    def chance(self, factor: float = 1.0) -> bool:
        return bool(self.rng.random() < self.evil * factor)

    def pick(self, *values):
        return values[self.rng.integers(len(values))]

    def cycle(self, number: int) -> None:
        rng, guidance = self.rng, self.guidance
        self.time += (
            self.ahead * self.period if not self.chance() else self.pick(0.0, 0.0, 0.001, 0.03, 5.0, -5.0, -self.time)
        )
        self.now += self.period if not self.chance() else self.pick(0.0, 0.0, 0.02, 2.0)
        self.quiet ^= self.chance(0.5)
        self.alive = self.alive if self.quiet else self.now
        self.blocked ^= self.chance(0.2)
        guidance.watch(self.now, self.alive)
        for arm in ARMS:
            self.command(arm, number)
            for _ in range(self.pick(0, 2, 5) if self.chance() else 1):
                self.message(arm)
        guidance.interrupted |= bool(self.chance(0.02))
        if rng.random() < 0.5:
            guidance.watch(self.now, self.alive)

    def message(self, arm: str) -> None:
        self.sequence[arm] += 1 if not self.chance(0.3) else self.pick(0, -1, 3, 50, -self.sequence[arm])
        commanded = self.guidance.arms[arm].commanded
        if commanded is not None and not self.blocked and self.guidance.enabled:
            self.joints[arm] = self.joints[arm] + 0.1 * (commanded - self.joints[arm])
        measured = self.joints[arm] + self.rng.normal(0, 1e-4, 7)
        if self.chance(0.1):
            measured[self.rng.integers(7)] = self.pick(np.nan, np.inf, -np.inf, 3.0, -0.3, 1e9)
        running = not self.chance(0.1)
        time, stamp = (round(self.time, 3), 7.0 + self.time) if self.stamped else (self.time, None)
        if self.stamped and self.chance():
            stamp = self.pick(None, np.nan, np.inf, 0.0, 7.0 + self.time + 0.0009, -self.time)
        number = self.sequence[arm] % (1 << 32)
        message = Feedback(number, time, measured, None, running, Mci.RUNNING, True, stamp=stamp)
        if self.guidance.hear(arm, message, self.now):
            self.witnesses[arm].see(message, self.now, self.answer(arm))

    def answer(self, arm: str):
        try:
            return self.guidance.answer(arm, self.now)
        except Exception as error:
            return self.guidance.recover(arm, error)

    def command(self, arm: str, number: int) -> None:
        guidance, where = self.guidance, self.guidance.arms[arm].commanded
        if number == 5 or self.chance(0.1):
            guidance.begin_answering()
        if number == 20 or self.chance(0.1):
            guidance.enable(self.now)
        if where is not None and not guidance.arms[arm].moving and self.rng.random() < 0.1 and number > 25:
            path = (
                hostile_path(self.rng, where)
                if self.rng.random() < 0.1 + self.evil
                else checked_path(self.rules, self.rng, where)
            )
            if path is not None:
                guidance.follow(arm, path.times, path.joints, number)
        if self.chance(0.3):
            guidance.halt(arm)
        if self.chance(0.1):
            guidance.disable()
        if self.chance(0.1):
            guidance.supervisor.stop("somebody shouted", brake=bool(self.rng.random() < 0.5))


def play(episodes: range) -> dict[str, int]:
    """Let peers do what they like; return how often what happened."""
    found = {"moved": 0, "stopped": 0}
    for seed in episodes:
        peer = Peer(seed)
        for number in range(EPISODE):
            peer.cycle(number)
        for witness in peer.witnesses.values():
            found["moved"] += witness.moved
        found["stopped"] += peer.guidance.supervisor.reason is not None
    return found
