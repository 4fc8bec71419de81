"""Where a carried box may be put down: on and beside what is there, and never into it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.clearance import Carried
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
ON_KIT = np.array([0.3, 0.0, 0.022])  # of the centre of a box that stands in the middle of the kit
HELD = Carried("left", "GreenBox", RigidTransform.identity())


def put(place, **boxes):
    """Plan to put GreenBox down at a place in the kit, among other boxes there; all places from its
    middle, m."""
    poses = {"KittingBox": RigidTransform.from_translation([0.3, 0, 0.001])}
    for name, there in boxes.items():
        poses[name] = RigidTransform.from_translation(ON_KIT + np.array(there))
    return Planner(YUMI, TASK).put(HELD, ON_KIT + np.array(place), 0.0, Surroundings(poses, dict(YUMI.home)))


@pytest.mark.parametrize("seen", [0.0, -0.002, 0.002])
def test_a_box_is_put_on_two_boxes_at_once(seen):
    """One of them is seen a little too low or too high."""
    reach = put((-0.0265, 0, 0.0407), YellowBox=(-0.053, 0, 0), BlueBox=(0, 0, seen))
    np.testing.assert_allclose(reach.tcp.translation, ON_KIT + np.array([-0.0265, 0, 0.0407]), atol=1e-6)


@pytest.mark.parametrize("gap", [0.004, 0.0, -0.001])
def test_a_box_is_put_beside_another_with_less_room_than_on_the_way(gap):
    put((0, 0, 0.0007), BlueBox=(0.04 + gap, 0, 0))


def test_a_box_is_put_on_one_and_beside_another():
    put((0, 0, 0.0407), YellowBox=(0, 0, 0), BlueBox=(0.042, 0, 0.04))


@pytest.mark.parametrize("aside", [0.0, 0.02, 0.035])
def test_a_box_is_not_put_into_another(aside):
    with pytest.raises(Unplannable, match="BlueBox and GreenBox in hand"):
        put((0, 0, 0.0007), BlueBox=(aside, 0, 0))


def test_a_box_is_not_put_through_the_wall_of_the_kit():
    with pytest.raises(Unplannable, match="KittingBox and GreenBox in hand"):
        put((0.065, 0, 0.0007))
