import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.grasps import grasp_poses
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")


@pytest.mark.parametrize("arm", YUMI.arm_names)
def test_reachable_poses_are_solved_within_the_limits(arm):
    kinematics, rng, solved = ArmKinematics(YUMI, arm), np.random.default_rng(0), 0
    for seed in range(100):
        target = YUMI.forward(arm, rng.uniform(kinematics.lower, kinematics.upper))
        found = kinematics.solve(target, YUMI.home[arm], seed=seed)
        if found is not None:
            solved += 1
            np.testing.assert_allclose(YUMI.forward(arm, found).as_matrix(), target.as_matrix(), atol=1e-4)
            assert np.all(found >= kinematics.lower)
            assert np.all(found <= kinematics.upper)
    assert solved >= 99


def test_what_is_out_of_reach_has_no_solution():
    target = RigidTransform.from_translation([1.5, 0.0, 0.5])
    assert ArmKinematics(YUMI, "left").solve(target, YUMI.home["left"]) is None


def test_more_solutions_never_give_a_worse_one():
    kinematics, rng = ArmKinematics(YUMI, "right"), np.random.default_rng(3)
    for _ in range(10):
        target = YUMI.forward("right", rng.uniform(kinematics.lower, kinematics.upper))
        near = rng.uniform(kinematics.lower, kinematics.upper)
        costs = []
        for enough in (1, 6):
            found = kinematics.solve(target, near, enough=enough)
            costs.append(np.inf if found is None else kinematics.cost(found, near))
        assert costs[1] <= costs[0]


def test_a_line_is_straight():
    kinematics = ArmKinematics(YUMI, "left")
    down = grasp_poses(RigidTransform.from_translation([0.3, 0.1, 0.15]), TASK.objects[0], 0.05)[0]
    start = kinematics.solve(down, YUMI.home["left"])
    end = RigidTransform.from_components(down.translation - [0, 0, 0.1], down.rotation)
    line = kinematics.line(end, start, 10)
    for part, joints in zip(np.linspace(0, 1, 11), line, strict=True):
        here = YUMI.forward("left", joints)
        np.testing.assert_allclose(here.translation, down.translation - [0, 0, 0.1 * part], atol=1e-4)
        assert (here.rotation.inv() * down.rotation).magnitude() < 1e-3


def test_every_place_on_the_tables_is_within_reach_of_an_arm():
    kinematics = {arm: ArmKinematics(YUMI, arm) for arm in YUMI.arm_names}
    for table in TASK.tables:
        for x in (-0.5, 0.5):
            for y in (-0.5, 0.5):
                place = [table.position[0] + x * (table.size[0] - 0.08), table.position[1] + y * (table.size[1] - 0.08)]
                pose = grasp_poses(RigidTransform.from_translation([*place, table.top + 0.02]), TASK.objects[0], 0.05)[
                    0
                ]
                assert any(kinematics[arm].solve(pose, YUMI.home[arm]) is not None for arm in YUMI.arm_names)
