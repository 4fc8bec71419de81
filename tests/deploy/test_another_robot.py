"""Planning and skills with a robot that is not YuMi: one arm, six joints, another gripper."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.behaviors import parse_behavior
from bt_jax.deploy.execution.skills import RobotSkills
from bt_jax.deploy.link.cell_rules import cell_rules
from bt_jax.deploy.link.safety import check_trajectory
from bt_jax.deploy.planning.clearance import Carried, CellClearance
from bt_jax.deploy.planning.grasps import carried_pose, grasp_poses
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.planning.planner import Planner, Surroundings
from bt_jax.deploy.planning.timing import Pace
from bt_jax.deploy.planning.unplannable import Unplannable
from bt_jax.encoding.status import Status
from bt_jax.tasks import load_task
from tests.helpers.following import FollowingLink, carried_out
from tests.helpers.six_axis import SIX_AXIS

TASK = load_task("yumi_stack")
BOX, KIT = TASK.objects[0].name, TASK.kits[0].name


def at(x: float, y: float, turn: float = 0.0) -> RigidTransform:
    return RigidTransform.from_components([x, y, 0.02], Rotation.from_euler("z", turn))


POSES = {BOX: at(0.3, 0.24, 0.3), KIT: RigidTransform.from_translation([0.3, 0.0, 0.001])}


def test_reachable_poses_are_solved_within_the_limits():
    kinematics, rng, solved = ArmKinematics(SIX_AXIS, "arm"), np.random.default_rng(0), 0
    for seed in range(50):
        place = [rng.uniform(0.22, 0.38), rng.uniform(-0.3, 0.3), rng.uniform(0.02, 0.08)]
        target = grasp_poses(at(*place[:2], rng.uniform(0, np.pi)), TASK.objects[0], 0.06)[0]
        found = kinematics.solve(target, SIX_AXIS.home["arm"], seed=seed)
        if found is not None:
            solved += 1
            np.testing.assert_allclose(SIX_AXIS.forward("arm", found).as_matrix(), target.as_matrix(), atol=1e-4)
            assert np.all((found >= kinematics.lower) & (found <= kinematics.upper))
    assert solved >= 49


def test_a_pick_and_a_place_are_planned_clear_of_everything_and_within_the_rules():
    planner, rules = Planner(SIX_AXIS, TASK), cell_rules(SIX_AXIS, TASK)
    assert rules.clearance_of is not None
    clearance = rules.clearance_of()
    home = {arm: joints.copy() for arm, joints in SIX_AXIS.home.items()}
    pick = planner.pick(BOX, Surroundings(POSES, home), ["arm"])
    seen = CellClearance(SIX_AXIS, TASK)
    seen.place(POSES, gripped=BOX)
    np.testing.assert_array_equal(pick.approach.rows[[0, -1]], [home["arm"], pick.line[0]])
    trajectory = planner.timed(pick.approach, Pace())
    checked = check_trajectory(rules, "arm", trajectory, commanded=home["arm"], others={}, clearance=clearance)
    assert all(seen.slack({"arm": row}) >= 0 for row in (*checked.joints[::10], *pick.line))
    grasped = SIX_AXIS.forward("arm", pick.line[-1])
    np.testing.assert_allclose(grasped.translation, POSES[BOX].translation, atol=1e-4)

    carried = Carried("arm", BOX, carried_pose(grasped, POSES[BOX], TASK.objects[0]))
    among = Surroundings({KIT: POSES[KIT]}, {"arm": pick.line[0]}, carried)
    goal = POSES[KIT].apply([0, 0, 0.022])
    put = planner.put(carried, goal, 0.0, among)
    released = SIX_AXIS.forward("arm", put.line[-1]) * carried.pose
    np.testing.assert_allclose(released.translation, goal, atol=1e-4)
    with pytest.raises(Unplannable, match="no arm reaches"):
        planner.put(carried, np.array([0.9, 0.0, 0.02]), 0.0, among)


def test_the_skills_pick_a_box_and_put_it_where_it_should_be():
    link = FollowingLink(TASK, {**POSES, "GreenBox": at(0.3, -0.24)}, SIX_AXIS)
    skills = RobotSkills(SIX_AXIS, TASK, link)
    assert carried_out(skills, link, parse_behavior(f"pick({BOX})")) == Status.SUCCESS, skills.reason
    assert link.seen().holding == BOX
    place = parse_behavior(f"place({BOX}, (0, 0, 0.022), {KIT})")
    assert carried_out(skills, link, place, seconds=120) == Status.SUCCESS, skills.reason
    assert np.linalg.norm(link.boxes[BOX].translation - POSES[KIT].apply([0, 0, 0.022])) < 0.0015
    assert link.seen().holding is None


def test_what_the_only_arm_cannot_reach_is_said():
    link = FollowingLink(TASK, {**POSES, KIT: RigidTransform.from_translation([0.8, 0.0, 0.001])}, SIX_AXIS)
    skills = RobotSkills(SIX_AXIS, TASK, link)
    assert carried_out(skills, link, parse_behavior(f"pick({BOX})")) == Status.SUCCESS, skills.reason
    place = parse_behavior(f"place({BOX}, (0, 0, 0.022), {KIT})")
    assert carried_out(skills, link, place, seconds=120) == Status.FAILURE
    assert skills.reason == f"no arm reaches the place for {BOX}"
