"""Arms that do not do at once as they are sent."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.settings import MotionSettings
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import TICK, FollowingLink, carried_out

TASK = load_task("yumi_stack")
PICK = parse_behavior("pick(YellowBox)")
BOX = RigidTransform.from_translation([0.3, 0.24, 0.02])


class LateLink(FollowingLink):
    """Arms are measured where they were sent some ticks ago, and `off` that [rad]."""

    def __init__(self, ticks: int, off: float = 0.0) -> None:
        super().__init__(TASK, {"YellowBox": BOX})
        self.ticks, self.off = ticks, off
        self.past = {arm: [self.joints[arm].copy()] * (ticks + 1) for arm in self.arms}
        self.closed_from: list[float] = []

    def wait(self, until):
        super().wait(until)
        for arm in self.arms:
            self.past[arm] = [*self.past[arm][1:], self.joints[arm].copy()]

    def arm(self, arm):
        return dataclasses.replace(super().arm(arm), joints=self.past[arm][0] + self.off)

    def grip(self, arm, opening, force=10.0):
        super().grip(arm, opening, force)
        if opening < YUMI.arm(arm).gripper.opening:
            self.closed_from.append(float(np.abs(self.arm(arm).joints - self.joints[arm]).max()))


@pytest.mark.parametrize("ticks", [0, 2, 5])
def test_fingers_close_where_the_arm_is_measured_to_have_arrived(ticks):
    link = LateLink(ticks)
    skills = RobotSkills(YUMI, TASK, link)
    assert carried_out(skills, link, PICK) == Status.SUCCESS, skills.reason
    assert max(link.closed_from) <= MotionSettings().arrived


def test_an_arm_that_does_not_come_where_it_was_sent_has_failed():
    link = LateLink(0, off=0.1)
    skills = RobotSkills(YUMI, TASK, link)
    assert carried_out(skills, link, PICK) == Status.FAILURE
    assert skills.reason == "the left arm rests 5.7 deg from the end of its path; something holds it"
    assert link.time < 10 + MotionSettings().settle + TICK
    assert not link.closed_from
