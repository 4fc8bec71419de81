import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.behaviors import parse_behavior
from bt_jax.deploy import yumi
from bt_jax.deploy.execution.skills import YumiSkills
from bt_jax.deploy.planning.planner import Planner, Unplannable
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import FollowingLink

TASK = load_task("yumi_stack")


def away() -> dict[str, np.ndarray]:
    """Both arms at home but for a turn of the left one's last joint."""
    joints = {arm: yumi.HOME[arm].copy() for arm in yumi.ARMS}
    joints["left"][-1] += 0.4
    return joints


def polled_until_done(skills: YumiSkills, link: FollowingLink) -> Status:
    while (status := skills.poll(link.seen())) == Status.RUNNING:
        time.sleep(0.01)
    return status


@pytest.fixture(scope="module")
def process():
    with PlanningProcess(TASK) as process:
        yield process


def test_it_plans_what_a_planner_plans(process):
    planned = process.submit("home", "left", {}, away()).result(30)
    np.testing.assert_allclose(planned, Planner(TASK).home("left", {}, away()))


def test_what_cannot_be_planned_is_raised_here(process):
    inside = {"YellowBox": yumi.forward("left", yumi.HOME["left"])}
    with pytest.raises(Unplannable):
        process.submit("pick", "YellowBox", {**inside, "GreenBox": inside["YellowBox"]}, away(), ["right"]).result(60)


@pytest.mark.parametrize("noticed", [False, True])
def test_a_dead_process_is_told(noticed):
    link = FollowingLink(TASK, {"YellowBox": RigidTransform.from_translation([0.3, 0.24, 0.02])})
    with PlanningProcess(TASK) as process:
        skills = YumiSkills(TASK, link, background=process)
        for worker in process._pool._processes.values():
            os.kill(worker.pid, signal.SIGKILL)
        if noticed:
            with pytest.raises(BrokenProcessPool):
                process.submit("home", "left", {}, away()).result(30)
        skills.start(parse_behavior("pick(YellowBox)"), link.seen())
        with pytest.raises(UserError, match="has ended; start the run again"):
            polled_until_done(skills, link)


def test_ticks_go_on_while_a_plan_is_made(process):
    link = FollowingLink(TASK, {"YellowBox": RigidTransform.from_translation([0.3, 0.24, 0.02])})
    skills = YumiSkills(TASK, link, background=process)
    skills.start(parse_behavior("pick(YellowBox)"), link.seen())
    polls = 0
    while not link.arm("left").moving:
        assert skills.poll(link.seen()) == Status.RUNNING
        polls += 1
        time.sleep(0.005)
    assert polls > 2
    skills.cancel()
    assert not link.arm("left").moving
