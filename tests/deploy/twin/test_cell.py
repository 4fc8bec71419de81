import numpy as np
import pytest
from scipy.spatial.transform import Rotation

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
        height = place.translation[2] + task.kit.thickness / 2 + 0.02 + 0.04 * level
        pose = [*place.translation[:2], height, *(turn * lying).as_quat(scalar_first=True)]
        qpos[at : at + 7] = pose
    assert max(target_distances(scene, qpos)) < 0.002
    assert solved(scene, qpos)
    qpos[at] += 0.02
    assert not solved(scene, np.array(qpos))
