import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.planning.grasps import DOWN
from bt_jax.deploy.planning.kinematics import ArmKinematics
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene, solved, target_distances
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks import load_task


@pytest.mark.parametrize("lying", [Rotation.identity(), Rotation.from_euler("x", 90, degrees=True)])
def test_a_stack_on_a_box_that_lies_on_its_side_is_solved(lying):
    task = load_task("yumi_stack")
    scene = build_scene(YUMI, task, 0, Realism.perfect())
    qpos, place, turn = scene.cell.qpos.copy(), scene.kit, Rotation.from_euler("z", 0.4)
    for level, target in enumerate(task.targets):
        at = scene.model.jnt_qposadr[scene.model.body(target.object).jntadr[0]]
        height = place.translation[2] + task.kits[0].thickness / 2 + 0.02 + 0.04 * level
        pose = [*place.translation[:2], height, *(turn * lying).as_quat(scalar_first=True)]
        qpos[at : at + 7] = pose
    assert max(target_distances(scene, qpos)) < 0.002
    assert solved(scene, qpos)
    qpos[at] += 0.02
    assert not solved(scene, np.array(qpos))


@pytest.mark.parametrize("deep", [0.0067, 0.0085])
def test_a_flat_plate_stays_where_the_fingers_hold_it(deep):
    """Only a few millimetres of it are between them; `deep` is where its middle is below the TCP, m."""
    task, arm = load_task("yumi_kit4"), YUMI.arm("left")
    scene = build_scene(YUMI, task, 0)
    model, data, plate = scene.model, mujoco.MjData(scene.model), scene.model.body("Plate")
    place = RigidTransform.from_components([0.3, 0.2, 0.2], Rotation.from_euler("z", 0.3) * DOWN)
    joints = ArmKinematics(YUMI, "left").solve(place, YUMI.home["left"])
    held = RigidTransform.from_components([0, 0, deep], DOWN * Rotation.from_euler("z", np.pi / 2))
    servos, fingers = ([model.actuator(name).id for name in names] for names in (arm.actuator_names, arm.finger_names))
    data.qpos[:] = scene.cell.qpos
    data.qpos[[model.joint(name).qposadr[0] for name in arm.joint_names]] = joints
    data.qpos[[model.joint(name).qposadr[0] for name in arm.finger_names]] = task.thing("Plate").size[1] / 2
    at = model.jnt_qposadr[plate.jntadr[0]]
    data.qpos[at : at + 3] = (place * held).translation
    data.qpos[at + 3 : at + 7] = (place * held).rotation.as_quat(scalar_first=True)
    model.actuator_forcelimited[fingers], model.actuator_forcerange[fingers] = True, (-15, 15)
    right = YUMI.arm("right")
    data.ctrl[[model.actuator(name).id for name in right.actuator_names]] = right.home
    for step in range(3000):
        time = step * model.opt.timestep
        data.ctrl[servos] = joints + np.sin([2 * time, 0, 0, 0, 3 * time, 2.5 * time, 2 * time]) * (
            0.15,
            0,
            0,
            0,
            0.1,
            0.1,
            0.3,
        )
        mujoco.mj_step(model, data)
    now = YUMI.forward("left", data.qpos[[model.joint(name).qposadr[0] for name in arm.joint_names]])
    assert np.linalg.norm(data.qpos[at : at + 3] - (now * held).translation) < 0.001
