"""Paths, grippers and the log of a link, with everything real but the robot; time is simulated."""

import dataclasses

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.link.egm import CYCLE
from bt_jax.deploy.link.protocol import RobotLink
from bt_jax.deploy.link.safety import Rejected
from bt_jax.deploy.planning.trajectory import Trajectory
from tests.helpers.cells import ARMS, RULES, XML, move, run_for, running


@pytest.fixture(scope="module")
def lockstep():
    with running(realtime=False) as pair:
        yield pair


def test_follows_a_path_with_both_arms(lockstep):
    _, link = lockstep
    assert isinstance(link, RobotLink)
    goals = {arm: link.arm(arm).commanded + 0.2 for arm in ARMS}
    numbers = [move(link, arm, 0.2) for arm in ARMS]
    assert numbers[1] > numbers[0]
    run_for(link, 0.1)
    assert all(link.arm(arm).moving for arm in ARMS)
    run_for(link, 1.5)
    for arm in ARMS:
        state = link.arm(arm)
        assert not state.moving
        np.testing.assert_allclose(state.commanded, goals[arm], atol=1e-9)
        np.testing.assert_allclose(state.joints, goals[arm], atol=2e-3)
    assert link.counters().lost == link.counters().reordered == 0


def test_time_is_that_of_the_simulation(lockstep):
    controller, link = lockstep
    start, cycles = link.now(), controller.stats().cycles
    run_for(link, 2.0)
    assert link.now() == pytest.approx(start + 2.0)
    assert controller.stats().cycles - cycles == 500
    assert link.arm("left").time == pytest.approx(link.now(), abs=1e-3)


def test_halting_is_smooth_and_on_the_path(lockstep):
    _, link = lockstep
    start = link.arm("left").commanded
    move(link, by=-0.4)
    run_for(link, 0.4)
    link.drain()
    link.halt("left")
    run_for(link, 0.6, until=lambda: False)
    state = link.arm("left")
    assert not state.moving
    done = (state.commanded - start) / -0.4
    np.testing.assert_allclose(done, done[0], atol=1e-9)
    assert 0.4 < done[0] < 0.7
    records = link.drain()
    setpoints = records[records[:, 0] == 0][:, 2]
    assert np.all(np.diff(np.abs(np.diff(setpoints))) < 1e-9), "speed only falls"
    assert link.stopped() is None


def test_the_gripper_moves_and_is_blocked_by_nothing(lockstep):
    _, link = lockstep
    link.grip("right", 0.02)  # as the program does it: closing goes on until something is met
    run_for(link, 1.5)
    assert link.arm("right").opening == pytest.approx(0.0, abs=1e-3)
    assert link.arm("right").grip_target == 0.02
    link.grip("right", 0.05, force=20.0)
    run_for(link, 1.5)
    assert link.arm("right").opening == pytest.approx(0.05, abs=1e-3)


def test_a_path_that_breaks_a_rule_moves_nothing(lockstep):
    _, link = lockstep
    before, rejected = link.arm("left").commanded, link.counters().rejected
    for by, seconds in [(2.5, 3.0), (0.5, 0.05), (np.nan, 1.0)]:
        with pytest.raises(Rejected):
            move(link, by=by, seconds=seconds)
    with pytest.raises(Rejected, match="begins"):
        link.follow("left", Trajectory(np.array([0.0, 1.0]), np.stack([before + 0.1, before])))
    run_for(link, 0.2)
    np.testing.assert_array_equal(link.arm("left").commanded, before)
    assert link.counters().rejected == rejected + 4
    assert link.stopped() is None


def test_the_log_has_every_cycle(lockstep):
    _, link = lockstep
    link.drain()
    run_for(link, 1.0)
    records = link.drain()
    for index in range(len(ARMS)):
        rows = records[records[:, 0] == index]
        np.testing.assert_allclose(np.diff(rows[:, 1]), CYCLE, atol=1.1e-3)
        np.testing.assert_array_equal(np.diff(rows[:, 16]), 1)


def test_a_hand_moves_boxes_only(lockstep):
    controller, link = lockstep
    controller.put("box", RigidTransform.from_translation([0.4, 0.1, 0.02]))
    run_for(link, 0.2)
    np.testing.assert_allclose(controller.state()[1][:3], [0.4, 0.1, 0.02], atol=1e-3)
    controller.push("box", np.array([3.0, 0, 0]), 0.2)
    run_for(link, 0.5)
    assert controller.state()[1][0] > 0.41
    with pytest.raises(UserError, match="refuses put"):
        controller.put("nothing", RigidTransform.identity())


def test_interrupting_brings_the_arms_to_rest_on_the_path():
    with running(realtime=False) as (_, link):
        start = link.arm("left").commanded
        move(link, by=0.5)
        run_for(link, 0.3)
        link.interrupt()
        run_for(link, 0.5)
        state = link.arm("left")
        assert not state.moving
        assert np.all((state.commanded > start + 0.1) & (state.commanded < start + 0.3))
        with pytest.raises(Rejected, match="interrupted"):
            move(link)


def near(joints):
    return float(0.5 - abs(joints["left"][0] - joints["right"][0]))


def make_near():
    return near


def test_clearance_is_watched_for_paths_and_while_moving():
    rules = dataclasses.replace(RULES, clearance=0.1, clearance_of=make_near)
    with running(realtime=False, rules=rules) as (_, link):
        with pytest.raises(Rejected, match="mm"):
            move(link, by=0.5)
        assert link.stopped() is None
        move(link, "left", by=0.3)
        move(link, "right", by=-0.3)  # each alone is clear of where the other is sent now; together they are not
        run_for(link, 1.0, until=lambda: link.stopped() is not None)
        assert "near" in link.stopped()
        held = link.arm("left").commanded
        run_for(link, 0.3)
        np.testing.assert_array_equal(link.arm("left").commanded, held)


def test_the_flange_is_told_as_the_arm_has_it():
    with running(realtime=False) as (controller, link):
        move(link, by=0.4)
        run_for(link, 1.5)
        model = mujoco.MjModel.from_xml_string(XML)
        data = mujoco.MjData(model)
        data.qpos[:] = controller.state()[1]
        mujoco.mj_kinematics(model, data)
        site, told = data.site("left_flange"), link.arm("left").flange
        np.testing.assert_allclose(told.translation, site.xpos, atol=1e-3)
        np.testing.assert_allclose(told.rotation.as_matrix(), site.xmat.reshape(3, 3), atol=1e-2)
