import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.homing import take_home
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task
from tests.helpers.following import FollowingLink

TASK = load_task("yumi_stack")


class Eyes:
    """Sees all of a link's boxes until `fails` is called for."""

    def __init__(self, link, fails=lambda: False):
        self.link, self.fails, self.lost, self.last = link, fails, "", 0.0

    def update(self):
        if not self.fails():
            self.last = self.link.now()

    def poses(self, now):
        return self.link.boxes

    @property
    def image(self):
        return self.last

    def findings(self, now):
        return ()

    def measured(self):
        return {}


@pytest.fixture
def link():
    link = FollowingLink(TASK, {TASK.kits[0].name: RigidTransform.from_translation([0.3, 0.0, 0.001])})
    for arm in YUMI.arms:
        link.joints[arm.name] = YUMI.home[arm.name] + 0.6 * (np.arange(len(arm.lower)) == 0)
    return link


def off(link):
    return max(np.abs(link.joints[arm] - YUMI.home[arm]).max() for arm in link.arms)


@pytest.mark.parametrize("eyes", [True, False])
def test_the_arms_come_home_with_and_without_a_camera(link, eyes):
    skills = RobotSkills(YUMI, TASK, link)
    assert take_home(link, skills, Eyes(link) if eyes else None, keep=False) == ""
    assert off(link) < 0.05
    assert link.stopped() is None


def dies(link):
    raise RuntimeError("unplugged")


def stalls(link):
    return True


@pytest.mark.parametrize(("fault", "said"), [(dies, "unplugged"), (stalls, "no new image for 1.")])
def test_a_camera_that_fails_on_the_way_stops_the_arms(link, fault, said):
    skills = RobotSkills(YUMI, TASK, link)
    before = off(link)
    problem = take_home(link, skills, Eyes(link, lambda: off(link) < 0.98 * before and fault(link)), keep=False)
    assert problem.startswith("the camera has failed: ")
    assert said in problem
    assert link.stopped() == problem
    assert off(link) > 0.05


def test_a_stop_on_the_way_is_what_is_told(link):
    skills = RobotSkills(YUMI, TASK, link)

    class Stopping(Eyes):
        def update(self):
            super().update()
            if self.link.now() > 1.0:
                self.link.stop("left: the emergency stop was pressed")

    assert take_home(link, skills, Stopping(link), keep=False) == "left: the emergency stop was pressed"


def test_arms_that_do_not_come_home_in_time_are_told_and_halted(link, monkeypatch):
    skills = RobotSkills(YUMI, TASK, link)
    monkeypatch.setattr("bt_jax.deploy.execution.homing.SECONDS", 0.5)
    assert take_home(link, skills, None, keep=False) == "the arms are not home after 0.5 s"
    assert link.halted
