"""A number that is not finite passes no gate between what is measured and an arm that moves."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform

from bt_jax._util.errors import UserError
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.rws import Rws
from bt_jax.deploy.link.safety import SIGNED, Rejected, check_setpoint, check_trajectory
from bt_jax.deploy.link.setpoints import SetpointStream
from bt_jax.deploy.link.supervision import Supervisor
from bt_jax.deploy.perception.tracker import Tracker
from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.trajectory import Trajectory
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers import guided
from tests.helpers.following import FollowingLink
from tests.helpers.ideal import IdealCell

NOT_FINITE = st.sampled_from([np.nan, np.inf, -np.inf])
RULES = dataclasses.replace(guided.RULES, acceleration=(20.0,))
REST = np.zeros(7)
PATH = Trajectory(np.array([0.0, 1.0]), np.array([REST, REST + 0.05]))


def spoilt(array, value, at: int):
    """The array with one number replaced."""
    array = np.array(array, float)
    array.reshape(-1)[at % array.size] = value
    return array


def test_no_rule_is_left_out_by_what_is_not_a_number():
    rules = vars(RULES)
    real = {name for name, value in rules.items() if isinstance(value, float | tuple)}
    assert set(rules) - real == {"gap", "points", "clearance_of"}, "neither a count nor a function can be one"
    for name in real:
        bad = (np.nan, *rules[name][1:]) if isinstance(rules[name], tuple) else np.nan
        with pytest.raises(ValueError, match=f"'{name}' is not a number"):
            dataclasses.replace(RULES, **{name: bad})
        if name != "override":
            with pytest.raises(ValueError, match=f"'{name}' is not finite"):
                dataclasses.replace(RULES, **{name: (np.inf,) * len(bad) if isinstance(bad, tuple) else np.inf})
        if name not in SIGNED:
            with pytest.raises(ValueError, match=f"'{name}' is negative"):
                dataclasses.replace(RULES, **{name: (-1.0,) * len(bad) if isinstance(bad, tuple) else -1.0})


@given(NOT_FINITE, st.integers(0, 13))
def test_no_path_is_admitted(value, at):
    near = {"commanded": REST, "others": {"right": REST}, "clearance": lambda joints: 1.0}
    check_trajectory(RULES, "left", PATH, **near)
    with pytest.raises(Rejected):
        check_trajectory(RULES, "left", Trajectory(PATH.times, spoilt(PATH.joints, value, at)), **near)
    with pytest.raises(Rejected):
        check_trajectory(RULES, "left", PATH, **(near | {"commanded": spoilt(REST, value, at)}))
    if value < np.inf:
        with pytest.raises(Rejected):
            check_trajectory(RULES, "left", PATH, **(near | {"clearance": lambda joints: value}))
        with pytest.raises(Rejected):
            check_trajectory(RULES, "left", PATH, **(near | {"clearance": lambda joints: np.nan}))


@given(NOT_FINITE, st.integers(0, 6))
def test_no_setpoint_is_admitted(value, at):
    with pytest.raises(Rejected):
        check_setpoint(RULES, "left", spoilt(REST, value, at))
    elsewhere = dataclasses.replace(RULES, points=lambda arm, joints: {"tcp": spoilt([0.3, 0, 0.3], value, at)})
    with pytest.raises(Rejected):
        check_setpoint(elsewhere, "left", REST)
    supervisor = Supervisor(RULES, ("left", "right"))
    assert not supervisor.permits("left", spoilt(REST, value, at), before=REST)
    assert supervisor.reason is not None
    measured = SetpointStream(RULES, REST).off(spoilt(REST, value, at))
    supervisor = Supervisor(RULES, ("left", "right"))
    supervisor.keep_up("left", measured)
    assert supervisor.reason is not None


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_the_watchdog_stops_at_a_clock_that_is_not_one(value):
    for now, alive in ((value, 0.0), (0.0, -value)):
        supervisor = Supervisor(RULES, ("left", "right"))
        supervisor.watch(now, alive, moving=False)
        assert supervisor.reason is not None
    near = dataclasses.replace(RULES, clearance_of=lambda: lambda joints: np.nan)
    for begins in (False, True):
        supervisor = Supervisor(near, ("left", "right"))
        if begins:
            supervisor.begin_path({"left": REST, "right": REST})
        supervisor.keep_clear({"left": REST, "right": REST}, "setpoints")
        assert supervisor.reason is not None


@given(NOT_FINITE, st.integers(0, 2))
def test_nothing_is_tracked(value, at):
    tracker, here = Tracker(), RigidTransform.from_translation([0.3, 0.1, 0.0])
    for time in (0.0, 0.1, 0.2, 0.3):
        tracker.update(time, {"Box": here})
    elsewhere = RigidTransform.from_translation(spoilt(here.translation, value, at))
    for number in range(1, 6):
        tracker.update(0.3 + 0.1 * number, {"Box": elsewhere, "Other": elsewhere})
        tracker.update(value, {"Box": here})
        tracker.update(0.3 + 0.1 * number, {"Box": here}, {"Box": value})
    assert set(tracker.poses(0.4)) == {"Box"}
    np.testing.assert_allclose(tracker.poses(0.4)["Box"].translation, here.translation)
    assert tracker.poses(value) == {}


@given(NOT_FINITE, st.integers(0, 6))
def test_nothing_is_planned_among_it(value, at):
    pose, joints = RigidTransform.from_translation([0.3, 0.1, 0.0]), {"left": REST, "right": REST}
    bad = RigidTransform.from_translation(spoilt(pose.translation, value, at))
    for poses, arms in (({"Box": bad}, joints), ({"Box": pose}, joints | {"left": spoilt(REST, value, at)})):
        with pytest.raises(Unplannable, match="not a number"):
            Surroundings(poses, arms)


def test_no_place_is_planned_to():
    planner, hand = Planner(YUMI, load_task("yumi_stack")), Carried("left", "YellowBox", RigidTransform.identity())
    among = Surroundings({}, {"left": REST, "right": REST})
    for position, yaw in (([0.3, np.nan, 0.1], 0.0), ([0.3, 0.0, 0.1], np.inf)):
        with pytest.raises(Unplannable, match="not a number"):
            planner.put(hand, np.array(position), yaw, among)
    assert not planner.can_reach("left", RigidTransform.from_translation([0.3, np.nan, 0.1]))


@given(NOT_FINITE, st.integers(0, 6))
def test_no_arm_is_at_home_by_it(value, at):
    link = FollowingLink(load_task("yumi_stack"), {})
    link.joints["left"] = spoilt(link.joints["left"], value, at)
    skills = RobotSkills(YUMI, load_task("yumi_stack"), link)
    skills.look()
    assert skills.poll(link.seen()) == Status.FAILURE
    assert "not a number" in skills.reason


@pytest.mark.parametrize("text", ["nan", "inf", "-INF", "1,5", "", "TRUE"])
def test_no_number_of_the_controller_is_taken(text, monkeypatch):
    rws = Rws("127.0.0.1", 1, "", "")
    monkeypatch.setattr(rws, "_get", lambda path, key: text)
    with pytest.raises(UserError, match="no number"):
        rws.number("RAPID/T_ROB_L/BtJax/grip_actual")


@pytest.mark.parametrize("age", [np.nan, np.inf, -np.inf, -3600.0])
def test_no_image_without_a_time_is_enough(age):
    cell = IdealCell()
    cell.image = age
    outcome = cell.executor.run()
    assert (outcome.exit_code, outcome.ticks) == (Exit.STOPPED, 0)
    assert "camera" in outcome.reason
