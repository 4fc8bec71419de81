"""Guidance that is driven message by message, without sockets, processes or a clock."""

import numpy as np

from bt_jax.deploy.link.egm import CYCLE, Feedback, Mci
from bt_jax.deploy.link.guidance import Guidance
from bt_jax.deploy.link.safety import Rules
from tests.helpers.cells import smooth

RULES = Rules(
    lower=(-1.0,) * 7,
    upper=(1.0,) * 7,
    speed=(2.0,) * 7,
    acceleration=(10.0,) * 7,
    lowest=(-0.2, -0.8, 0.0),
    highest=(0.8, 0.8, 1.2),
)
HERE = np.full(7, 0.1)
FAR = np.full(7, 0.8)


class GuidedCell:
    """One arm that is where it was sent some cycles ago, and a program above that is alive unless it `hangs`."""

    def __init__(self, rules=RULES, *, start=True, lag=1, period=CYCLE, arms=("left",), here=HERE) -> None:
        self.guidance, self.period, self.lag = Guidance(rules, arms, realtime=True), period, lag
        self.arm, self.supervisor = self.guidance.arms[arms[0]], self.guidance.supervisor
        self.time, self.sequence, self.alive, self.hangs = 10.0, 0, 10.0, False
        self.measured = None  # where the arm is held, if it is
        self.sent = [here.copy()]
        if start:
            self.guidance.begin_answering()
            self.run(5 * self.period)
            assert self.guidance.enable(self.time) is None
            self.alive = self.time

    def cycle(self, joints=None, *, passed=None):
        """Send one message to every arm; gives the setpoint that answers the first one."""
        self.time += self.period if passed is None else passed
        self.alive = self.alive if self.hangs else self.time
        self.guidance.watch(self.time, self.alive)
        self.sequence += 1
        where = self.measured if self.measured is not None else self.sent[-min(self.lag, len(self.sent))]
        where = where if joints is None else joints
        answers = []
        for arm in self.guidance.arms:
            message = Feedback(self.sequence, self.time, where.copy(), None, True, Mci.RUNNING, True)
            answers.append(
                self.guidance.answer(arm, self.time) if self.guidance.hear(arm, message, self.time) else None
            )
        if answers[0] is not None:
            self.sent.append(answers[0])
        return answers[0]

    def run(self, seconds):
        """The setpoints of some time."""
        return np.array([self.cycle() for _ in range(round(seconds / self.period))], object)

    def follow(self, goal=FAR, seconds=2.0):
        path = smooth(self.sent[-1], goal, seconds)
        assert self.guidance.follow("left", path.times, path.joints, 1) is None

    def speeds(self, since):
        """The speeds of the first joint from a setpoint on."""
        return np.diff(np.array(self.sent[since:])[:, 0]) / self.period
