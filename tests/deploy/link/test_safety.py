import dataclasses
import itertools

import numpy as np
import pytest

from bt_jax.deploy.link.safety import Rejected, Rules, check_setpoint, check_trajectory
from bt_jax.deploy.planning.trajectory import Trajectory
from tests.helpers.cells import smooth


def reach(arm, joints):
    """A one-joint arm of a metre in the plane."""
    tip = np.array([np.cos(joints[0]), np.sin(joints[0]), 0.5])
    return {"tcp": tip, "elbow": tip / 2}


RULES = Rules(
    lower=(-1.0,) * 7,
    upper=(1.0,) * 7,
    speed=(2.0,) * 7,
    acceleration=(20.0,),
    margin=0.1,
    lowest=(-0.1, -0.7, 0.0),
    highest=(1.1, 0.7, 1.0),
    points=reach,
)


def path(*points, seconds=1.0):
    """From rest to rest through points, which all joints share."""
    parts = [smooth(np.full(7, a), np.full(7, b), seconds / (len(points) - 1)) for a, b in itertools.pairwise(points)]
    joints = np.concatenate([parts[0].joints[:1], *(part.joints[1:] for part in parts)])
    return Trajectory(parts[0].times[1] * np.arange(len(joints)), joints)


def check(trajectory, rules=RULES, commanded=0.0, clearance=None):
    return check_trajectory(
        rules, "left", trajectory, commanded=np.full(7, commanded), others={"right": np.zeros(7)}, clearance=clearance
    )


@pytest.mark.parametrize(
    ("joint", "value", "word"),
    [(3, np.nan, "number"), (2, np.inf, "number"), (4, 0.95, "joint 5"), (6, -0.91, "joint 7"), (0, 0.8, "tcp")],
)
def test_a_setpoint_out_of_bounds_is_rejected(joint, value, word):
    joints = np.zeros(7)
    check_setpoint(RULES, "left", joints)
    joints[joint] = value
    with pytest.raises(Rejected, match=word):
        check_setpoint(RULES, "left", joints)


def test_a_path_is_rejected_as_a_whole():
    check(path(0, 0.3, 0.6))
    for bad, word in [
        (path(0, 0.5, 0.95, 0.5, seconds=4), "joint"),
        (path(0.1, 0.2), "begins"),
        (path(0, 0.6, seconds=0.2), "rad/s"),
        (path(0, 0.78, seconds=2), "workspace"),
        (path(0, np.nan), "number"),
    ]:
        with pytest.raises(Rejected, match=word):
            check(bad)


def test_a_path_that_comes_too_near_is_rejected_wherever_that_happens():
    def clearance(joints):
        return abs(joints["left"][0] - 0.3)

    check(path(0, 0.25), clearance=clearance)
    with pytest.raises(Rejected, match="mm"):
        check(path(0, 0.6), clearance=clearance)


def test_a_path_is_slowed_down_to_the_override():
    rules = dataclasses.replace(RULES, override=0.2)
    allowed = check(path(0, 0.5), rules)
    assert np.abs(allowed.speeds()).max() == pytest.approx(0.2)
    assert check(path(0, 0.1), rules).duration == 1.0


def test_a_path_that_jolts_is_rejected():
    at_once = Trajectory(np.array([0.0, 1.0]), np.stack([np.zeros(7), np.full(7, 0.3)]))
    with pytest.raises(Rejected, match="joint 1 of the chain would be accelerated by 75 rad/s2"):
        check(at_once)
    slowly = dataclasses.replace(RULES, acceleration=(20.0, 20.0, 5.0, 20.0, 20.0, 20.0, 20.0))
    with pytest.raises(Rejected, match="joint 3 of the chain would be accelerated by 7 rad/s2"):
        check(path(0, 0.3, seconds=0.5), slowly)
    check(path(0, 0.3, seconds=0.5), dataclasses.replace(slowly, override=0.3))


def test_an_arm_that_is_outside_may_only_come_back():
    outside, inside = np.full(7, 0.95), np.full(7, 0.5)
    check_setpoint(dataclasses.replace(RULES, points=None), "left", outside - 0.01, before=outside)
    there = dataclasses.replace(RULES, points=None)
    for goal, allowed in ((inside, True), (outside + 0.01, False), (outside - 0.02, True)):
        trajectory = smooth(outside, goal)
        near = {"commanded": outside, "others": {}, "clearance": None}
        if allowed:
            check_trajectory(there, "left", trajectory, **near)
        else:
            with pytest.raises(Rejected, match="beyond"):
                check_trajectory(there, "left", trajectory, **near)
    back = smooth(inside, outside)
    with pytest.raises(Rejected, match="beyond"):
        check_trajectory(there, "left", back, commanded=inside, others={}, clearance=None)


def test_a_point_that_is_outside_may_only_come_back():
    out, farther, nearer = np.zeros(7), np.zeros(7), np.zeros(7)
    out[0], farther[0], nearer[0] = 0.8, 0.81, 0.79
    check_setpoint(RULES, "left", nearer, before=out)
    with pytest.raises(Rejected, match="tcp"):
        check_setpoint(RULES, "left", farther, before=out)


def test_a_path_of_another_arms_joints_is_rejected():
    path = Trajectory(np.array([0.0, 1.0]), np.zeros((2, 6)))
    with pytest.raises(Rejected, match="6 joints, the arm has 7"):
        check_trajectory(RULES, "left", path, commanded=np.zeros(7), others={"right": np.zeros(7)}, clearance=None)
