import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.execution.line_of_sight import LineOfSight
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
UP = np.array([0.0, 0.0, 1.0])
HAND = YUMI.forward("left", YUMI.home["left"]).translation


@pytest.fixture(scope="module")
def arms():
    return LineOfSight(YUMI, TASK)


def sight(*points):
    return tuple(tuple(map(float, point)) for point in points)


def past_the_hand(aside: float):
    """A line straight down, to the left of the point between the left fingers [m]."""
    foot = HAND + np.array([0, aside, 0])
    return sight(foot + 0.5 * UP, foot - 0.2 * UP)


def test_a_hand_hides_what_lies_behind_it(arms):
    assert arms.blocked(YUMI.home, past_the_hand(0.0), 0.0)
    assert not arms.blocked(YUMI.home, past_the_hand(0.5), 0.05)


def test_what_lies_between_the_hand_and_the_camera_is_not_hidden(arms):
    eye = HAND + np.array([0.6, 0, 0.6])
    assert not arms.blocked(YUMI.home, sight(eye, HAND + 0.5 * (eye - HAND)), 0.05)
    assert arms.blocked(YUMI.home, sight(eye, HAND - 0.2 * (eye - HAND)), 0.05)


def test_one_place_that_is_hidden_is_enough(arms):
    eye = HAND + np.array([0.6, 0, 0.6])
    beside, behind = HAND + np.array([0, 0.5, 0]), HAND - 0.2 * (eye - HAND)
    assert arms.blocked(YUMI.home, sight(eye, beside, behind), 0.0)


def test_a_line_is_as_near_as_the_nearest_of_its_points(arms):
    """Spheres along the line, as large as the margin, meet a solid where the line is that near."""
    rng = np.random.default_rng(0)
    eye, verdicts = np.array([0.9, 0.0, 0.9]), []
    for _ in range(60):
        joints = {arm.name: rng.uniform(arm.lower, arm.upper) for arm in YUMI.arms}
        place = YUMI.forward("left", joints["left"]).translation + rng.normal(0, 0.1, 3)
        margin = rng.uniform(0.0, 0.06)
        verdicts.append(arms.blocked(joints, sight(eye, place), margin))
        points = eye + np.linspace(0, 1, 150)[:, None] * (place - eye)
        near = [arms.blocked(joints, sight(point, point + 1e-6 * UP), margin) for point in points]
        assert verdicts[-1] >= any(near)
        if verdicts[-1] and not any(near):
            wider = [arms.blocked(joints, sight(point, point + 1e-6 * UP), margin + 0.005) for point in points]
            assert any(wider)
    assert 5 < sum(verdicts) < 55


def test_a_hand_may_hold_a_box(arms):
    tcp = YUMI.forward("left", YUMI.home["left"])
    along = RigidTransform.from_components(tcp.translation, tcp.rotation)
    edge = max(box.edge for box in TASK.objects)
    corner = along.apply([0.45 * edge, 0.45 * edge, 0.45 * edge])
    away = along.rotation.apply([0, 0, 0.3])
    assert arms.blocked(YUMI.home, sight(corner + away, corner), 0.0)
