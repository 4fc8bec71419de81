import os
import signal
import time
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.planning.planner import JointPath, Planner, Surroundings
from bt_jax.deploy.planning.process import PlanningProcess
from bt_jax.deploy.planning.timing import Pace
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import FollowingLink

TASK = load_task("yumi_stack")


def away() -> dict[str, np.ndarray]:
    """Both arms at home but for a turn of the left one's last joint."""
    joints = {arm: YUMI.home[arm].copy() for arm in YUMI.arm_names}
    joints["left"][-1] += 0.4
    return joints


def polled_until_done(skills: RobotSkills, link: FollowingLink) -> Status:
    while (status := skills.poll(link.seen())) == Status.RUNNING:
        time.sleep(0.01)
    return status


@pytest.fixture(scope="module")
def process():
    with PlanningProcess(YUMI, TASK) as process:
        yield process


def test_it_plans_what_a_planner_plans(process):
    planned = process.submit("home", "left", Surroundings({}, away())).result(30)
    np.testing.assert_allclose(planned.rows, Planner(YUMI, TASK).home("left", Surroundings({}, away())).rows)


def test_what_cannot_be_planned_is_raised_here(process):
    inside = {"YellowBox": YUMI.forward("left", YUMI.home["left"])}
    among = Surroundings({**inside, "GreenBox": inside["YellowBox"]}, away())
    with pytest.raises(Unplannable):
        process.submit("pick", "YellowBox", among, ["right"]).result(60)


@pytest.mark.parametrize("noticed", [False, True])
def test_a_dead_process_is_told(noticed):
    link = FollowingLink(TASK, {"YellowBox": RigidTransform.from_translation([0.3, 0.24, 0.02])})
    with PlanningProcess(YUMI, TASK) as process:
        skills = RobotSkills(YUMI, TASK, link, background=process)
        for worker in process._pool._processes.values():
            os.kill(worker.pid, signal.SIGKILL)
        if noticed:
            with pytest.raises(BrokenProcessPool):
                process.submit("home", "left", Surroundings({}, away())).result(30)
        skills.start(parse_behavior("pick(YellowBox)"), link.seen())
        with pytest.raises(UserError, match="has ended; start the run again"):
            polled_until_done(skills, link)


def test_ticks_go_on_while_a_plan_is_made(process):
    link = FollowingLink(TASK, {"YellowBox": RigidTransform.from_translation([0.3, 0.24, 0.02])})
    skills = RobotSkills(YUMI, TASK, link, background=process)
    skills.start(parse_behavior("pick(YellowBox)"), link.seen())
    polls = 0
    while not link.arm("left").moving:
        assert skills.poll(link.seen()) == Status.RUNNING
        polls += 1
        time.sleep(0.005)
    assert polls > 2
    skills.cancel()
    assert not link.arm("left").moving


def test_a_path_is_timed_among_what_it_was_planned_among():
    """Whatever was planned in between: a corner that has no room stays a stop."""
    planner, among = Planner(YUMI, TASK), Surroundings({}, {arm: YUMI.home[arm].copy() for arm in YUMI.arm_names})
    bend = YUMI.home["left"] + 0.5 * np.array([[0, 0, 0, 0, 0, 0, 0], [1, 0, 0, 0, 0, 0, 0], [1, 0, -1, 0, 0, 0, 0]])
    path = JointPath("left", bend, among)
    expected = planner.timed(path, Pace())
    across = RigidTransform.from_rotation(Rotation.from_euler("z", np.pi / 4))  # no box that fits between the fingers
    crowd = {box: YUMI.forward("left", bend[1]) * across for box in TASK.object_names}
    crowded = planner.timed(JointPath("left", bend, Surroundings(crowd, among.joints)), Pace())
    assert crowded.duration > expected.duration, "boxes at the corner leave no room to cut it"
    assert planner.timed(path, Pace()).duration == expected.duration
