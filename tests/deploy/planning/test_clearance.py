import itertools

import mujoco
import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.planning.clearance import Carried, CellClearance, SafetyClearance
from bt_jax.deploy.planning.grasps import grasp_poses
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import box_poses, build_scene
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")


def touching(scene, joints):
    """Does MuJoCo find the robot in contact with anything but the floor, with open grippers?"""
    model, data = scene.model, mujoco.MjData(scene.model)
    data.qpos[:] = scene.cell.qpos
    for arm in YUMI.arm_names:
        for name, angle in zip(YUMI.arm(arm).joint_names, joints[arm], strict=True):
            data.qpos[model.joint(name).qposadr[0]] = angle
    mujoco.mj_forward(model, data)
    for k in range(data.ncon):
        geoms = data.contact[k].geom
        bodies = [model.body(model.geom_bodyid[geom]).name for geom in geoms]
        robot = any(name.startswith(YUMI.arm_names) for name in bodies)
        if robot and data.contact[k].dist < 0 and model.geom("scene/floor").id not in geoms:
            return True
    return False


def test_what_is_clear_here_has_no_contact_in_mujoco():
    scene, rng = build_scene(YUMI, TASK, 3), np.random.default_rng(0)
    clearance = CellClearance(YUMI, TASK)
    clearance.place(box_poses(scene, scene.cell.qpos) | dict(scene.kits))
    found = []
    for _ in range(300):
        spread = rng.uniform(0, 0.5)
        joints = {
            arm: (1 - spread) * YUMI.home[arm] + spread * rng.uniform(YUMI.arm(arm).lower, YUMI.arm(arm).upper)
            for arm in YUMI.arm_names
        }
        distance, contact = clearance.distance(joints), touching(scene, joints)
        found.append(contact)
        if contact:
            assert distance < 1e-3, clearance.nearest(joints)
    assert 20 < sum(found) < 280


def test_at_home_everything_is_clear():
    assert CellClearance(YUMI, TASK).slack(YUMI.home) > 0
    assert SafetyClearance(YUMI, TASK)()(YUMI.home) > 0.005


def test_a_carried_box_hangs_where_the_hand_has_it():
    tcp = grasp_poses(RigidTransform.from_translation([0.3, 0.0, 0.2]), TASK.objects[0], 0.05)[0]
    joints = ArmKinematics(YUMI, "left").solve(tcp, YUMI.home["left"])
    below = RigidTransform.from_translation([0.3, 0.0, 0.1])
    clearance = CellClearance(YUMI, TASK)
    rest = clearance.distance({**YUMI.home, "left": joints})
    for drop in (0.0, 0.02, 0.05):
        held = RigidTransform.from_translation([0.0, 0.0, drop])
        clearance.place({"YellowBox": below}, carried=Carried("left", "GreenBox", held))
        gap = 0.1 - drop - 0.04
        assert abs(clearance.distance({**YUMI.home, "left": joints}) - min(gap, rest)) < 1e-3


def test_what_may_be_touched_is_not_in_the_way():
    box = RigidTransform.from_translation([0.3, 0.1, 0.02])
    grasp = grasp_poses(box, TASK.objects[0], 0.05)[0]
    tcp = RigidTransform.from_components(box.translation + np.array([0.025, 0, 0]), grasp.rotation)
    joints = ArmKinematics(YUMI, "left").solve(tcp, YUMI.home["left"])
    clearance = CellClearance(YUMI, TASK)
    clearance.place({"BlueBox": box})
    assert clearance.slack({**YUMI.home, "left": joints}) < 0
    clearance.place({"BlueBox": box}, gripped="BlueBox")
    assert clearance.slack({**YUMI.home, "left": joints}) > 0


def test_distances_are_those_of_mujoco():
    """Between all shapes of the robot that may meet, and the tables."""
    scene, clearance, rng = (
        build_scene(YUMI, TASK, 0),
        CellClearance(YUMI, TASK, movable=False),
        np.random.default_rng(4),
    )
    model, data, line = scene.model, mujoco.MjData(scene.model), np.zeros(6)
    links = {YUMI.body: (None, 0)} | {arm.link_name(link): (arm, link) for arm in YUMI.arms for link in arm.links}
    of_robot = {k: links[name] for k in range(model.ngeom) if (name := model.body(model.geom_bodyid[k]).name) in links}
    tables = [model.geom(table.name).id for table in TASK.tables]
    pairs = [
        (i, j)
        for (i, (one, a)), (j, (other, b)) in itertools.combinations(of_robot.items(), 2)
        if (one is not other and one and other) or (one or other or YUMI.arms[0]).may_meet(a, b)
    ] + [(i, j) for i, (arm, _) in of_robot.items() for j in tables if arm is not None]
    for _ in range(25):
        joints = {arm.name: rng.uniform(arm.lower, arm.upper) for arm in YUMI.arms}
        for arm in YUMI.arms:
            for name, angle in zip(arm.joint_names, joints[arm.name], strict=True):
                data.qpos[model.joint(name).qposadr[0]] = angle
            for name in arm.finger_names:
                data.qpos[model.joint(name).qposadr[0]] = arm.gripper.stroke
        mujoco.mj_kinematics(model, data)
        expected = min(mujoco.mj_geomDistance(model, data, i, j, 1.0, line) for i, j in pairs)
        found = clearance.distance(joints)
        assert abs(found - expected) < 1e-4 if expected > 0 else found < 1e-4  # how deep is a matter of definition
