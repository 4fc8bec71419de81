"""Where a carried box may be put down: on and beside what is there, and never into it; and the way home."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.link.safety import Rules
from bt_jax.deploy.planning.clearance import Carried, CellClearance
from bt_jax.deploy.planning.grasps import carried_pose
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.timing import Pace
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


@pytest.mark.parametrize("nearer", [0.003, 0.005])
def test_fingers_that_let_go_pass_between_an_object_and_its_neighbour(nearer):
    """Open wide, they would come too near to the plate, which stands off its slot."""
    task = load_task("yumi_kit4")
    planner, tray = Planner(YUMI, task), RigidTransform.from_translation([0.3, 0, 0.001])
    bar = RigidTransform.from_translation([0.3, 0.2, 0.0155])
    held = carried_pose(planner.grasps("left", "Bar", bar)[0], bar, task.thing("Bar"))
    turned = Rotation.from_euler("z", 90, degrees=True)
    plate = tray * RigidTransform.from_components([nearer - 0.06, 0, 0.011], turned)
    among = Surroundings({"Tray": tray, "Plate": plate}, dict(YUMI.home))
    reach = planner.put(Carried("left", "Bar", held), tray.apply([0, 0, 0.0167]), 0.0, among, 90.0)
    assert np.abs(turned.inv().apply((reach.tcp * held).rotation.apply([1.0, 0, 0]))[1]) < 1e-6


def test_no_way_home_is_planned_so_near_to_a_table_that_it_would_be_rejected():
    task = load_task("yumi_kit4")
    planner, clearance = Planner(YUMI, task), CellClearance(YUMI, task, movable=False)
    above_can = np.array([-1.726, -0.959, 1.792, 0.601, -0.843, -1.281, -0.013])
    joints = {**YUMI.home, "left": above_can}
    among = Surroundings({"Tray": RigidTransform.from_translation([0.3, 0, 0.001])}, joints)
    for _ in range(3):
        path = planner.timed(planner.home("left", among), Pace())
        assert min(clearance.distance({**joints, "left": row}) for row in path.joints[::4]) >= Rules.clearance
