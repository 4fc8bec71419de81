import itertools

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.pipeline import Perception
from bt_jax.deploy.planning.pose_geometry import is_over_kit, lean, level, stands_on, table_under, turn_between
from tests.helpers.rendered import PLACEMENT, TASK, TOP, errors, fresh_scene

FACES = [
    Rotation.from_euler("xyz", quarters) for quarters in itertools.product(*[[0, np.pi / 2, np.pi, -np.pi / 2]] * 3)
]


@pytest.mark.parametrize("yaw", [0.3, -2.0])
def test_the_frame_of_a_cube_on_any_face_is_upright_and_one_of_the_cubes_own(yaw):
    shaken = Rotation.from_rotvec([0.02, -0.01, 0.0])
    for face in FACES:
        pose = RigidTransform.from_components([0.3, 0.1, 0.02], shaken * Rotation.from_euler("z", yaw) * face)
        upright = level(pose)
        assert np.degrees(np.arccos(upright.rotation.as_matrix()[2, 2])) < 2
        assert lean(upright) == pytest.approx(lean(pose), abs=1e-6) == pytest.approx(np.hypot(0.02, 0.01), abs=1e-4)
        between = (pose.rotation.inv() * upright.rotation).as_matrix()
        assert np.allclose(np.abs(between), np.abs(np.rint(between)), atol=1e-9)
        assert np.allclose(upright.translation, pose.translation)


def test_an_upright_cube_keeps_its_frame_and_a_tipped_one_its_yaw():
    for yaw in (0.0, 0.4, 3.0):
        upright = RigidTransform.from_rotation(Rotation.from_euler("z", yaw))
        assert errors(level(upright), upright)[1] < 1e-9
        for axis in "xy":
            for degrees in (90, -90):
                tipped = upright * RigidTransform.from_rotation(Rotation.from_euler(axis, degrees, degrees=True))
                assert errors(level(tipped), upright)[1] < 1e-5
        assert lean(upright * RigidTransform.from_rotation(Rotation.from_euler("x", 0.3))) == pytest.approx(0.3)


def test_on_top_of_a_box_on_its_side_is_against_gravity():
    scene = fresh_scene()
    side = Rotation.from_euler("z", 0.6) * Rotation.from_euler("x", np.pi / 2)
    scene.put("YellowBox", RigidTransform.from_components([0.3, 0.2, TOP + 0.02], side))
    perception = Perception(TASK, scene.camera, PLACEMENT.pose)
    for _ in range(3):
        scene.time += 0.1
        perception.update()
    above = perception.poses(scene.time)["YellowBox"].apply([0.0, 0.0, 0.04])
    assert above == pytest.approx([0.3, 0.2, TOP + 0.06], abs=0.001)


@pytest.mark.parametrize("angle", [0.0, 1e-6, 0.7, np.pi])
def test_the_turn_between_two_frames_is_that_about_any_axis(angle):
    start = RigidTransform.from_rotation(Rotation.from_euler("xyz", [0.3, -1.1, 2.0]))
    turned = RigidTransform.from_rotation(start.rotation * Rotation.from_rotvec(angle * np.array([0.6, 0.0, -0.8])))
    assert turn_between(start, turned) == pytest.approx(angle, abs=1e-9)


def test_a_box_stands_on_another_on_the_kit_or_on_a_table():
    names, table = TASK.object_names, TASK.tables[0]
    middle = np.array([*table.position[:2], table.top + 0.02])
    poses = {name: RigidTransform.from_translation(middle + np.array([0, 0, 0.04 * k])) for k, name in enumerate(names)}
    stacked = [(a, b) for a in names for b in names if stands_on(TASK, a, b, poses)]
    assert stacked == [(names[1], names[0]), (names[2], names[1])]
    assert stands_on(TASK, names[2], names[0], poses, above_most=np.inf)
    turned = RigidTransform.from_components([0.3, 0.1, 0.0], Rotation.from_euler("z", np.pi / 4))
    edge = TASK.kits[0].size[0] / 2
    assert is_over_kit(TASK.kits[0], turned, turned.apply([0.9 * edge, 0.9 * edge, 0.2]))
    assert not is_over_kit(TASK.kits[0], turned, turned.translation + np.array([0.9 * edge, 0.9 * edge, 0.0]))
    assert table_under(TASK, middle) == table
    assert table_under(TASK, np.array([5.0, 0.0, 0.0])) is None
