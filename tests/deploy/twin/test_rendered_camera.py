"""What the twin's camera makes of a scene, and where our side believes it to be."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.rendered_camera import RenderedCamera
from bt_jax.deploy.twin.sensor import Sensor
from bt_jax.deploy.twin.settings import Realism
from tests.helpers.rendered import TASK, fresh_scene

SMALL = dataclasses.replace(Realism.perfect(), width=320, height=240)


def step_edge():
    image = np.full((240, 320, 3), 60, np.uint8)
    image[:, 160:] = 180
    return image


def test_a_perfect_sensor_changes_nothing():
    image = step_edge()
    assert np.array_equal(Sensor(SMALL)(image), image)


def test_blur_spreads_an_edge_by_its_sigma():
    rows = Sensor(dataclasses.replace(SMALL, blur=1.0))(step_edge())[0, :, 0].astype(float)
    slope = np.diff(rows)
    places = np.arange(len(slope))
    centre = (slope * places).sum() / slope.sum()
    assert np.sqrt((slope * (places - centre) ** 2).sum() / slope.sum()) == pytest.approx(1.0, abs=0.1)


def test_noise_has_its_standard_deviation_and_differs_from_image_to_image_and_not_from_run_to_run():
    noisy = dataclasses.replace(SMALL, noise=3.0)
    sensor, again = Sensor(noisy, 5), Sensor(noisy, 5)
    first, second = (sensor(np.full((240, 320, 3), 120, np.uint8)).astype(float) for _ in range(2))
    assert first.std() == pytest.approx(3.0, abs=0.1)
    assert np.corrcoef(first.ravel(), second.ravel())[0, 1] < 0.05
    assert np.array_equal(first, again(np.full((240, 320, 3), 120, np.uint8)))


def test_a_stop_is_a_factor_of_two_in_light():
    dark = Sensor(dataclasses.replace(SMALL, exposure=-1.0))(np.full((240, 320, 3), 200, np.uint8))
    assert (dark[0, 0, 0] / 200) ** 2.2 == pytest.approx(0.5, abs=0.01)


def test_an_image_is_new_at_the_camera_s_rate_and_of_the_size_that_was_asked_for():
    scene = fresh_scene()
    camera = RenderedCamera(
        scene.model, lambda: (scene.time, scene.data.qpos), realism=dataclasses.replace(SMALL, rate=10.0)
    )
    try:
        times = []
        for _ in range(20):
            scene.time += 0.04
            times.append(camera.read().time)
        assert camera.read().image.shape == (240, 320, 3)
    finally:
        camera.close()
    assert np.diff(sorted(set(times))).min() >= 0.095
    assert len(set(times)) == 7, "every 0.12 s, the first time that one is due"


def test_a_camera_that_was_moved_is_elsewhere_than_the_calibration_says():
    perfect = build_scene(YUMI, TASK, 1, SMALL)
    base = RigidTransform.from_translation(TASK.robot_position)
    assert np.allclose((base * perfect.calibrated).as_matrix(), perfect.camera.pose.as_matrix())
    moved = build_scene(
        YUMI,
        TASK,
        1,
        dataclasses.replace(SMALL, camera_moved=(0.0, 0.0, 0.005), camera_turned=(0.0, np.radians(1), 0.0)),
    )
    assert np.allclose(moved.calibrated.as_matrix(), perfect.calibrated.as_matrix())
    off = moved.camera.pose * perfect.camera.pose.inv()
    assert np.allclose(moved.camera.pose.translation - perfect.camera.pose.translation, [0, 0, 0.005])
    assert np.degrees(off.rotation.magnitude()) == pytest.approx(1.0)
    assert np.allclose(moved.model.camera("cell").pos, moved.camera.pose.translation)


def test_the_calibration_is_wrong_by_as_much_as_was_asked_for_in_a_direction_of_the_seed():
    real = dataclasses.replace(SMALL, camera_error=0.002, camera_tilt=0.003)
    base = RigidTransform.from_translation(TASK.robot_position)
    errors = []
    for seed in (1, 2, 1):
        scene = build_scene(YUMI, TASK, seed, real)
        errors.append((base * scene.calibrated).translation - scene.camera.pose.translation)
        turn = (scene.camera.pose.inv() * base * scene.calibrated).rotation.magnitude()
        assert np.linalg.norm(errors[-1]) == pytest.approx(0.002)
        assert turn == pytest.approx(0.003)
    assert np.array_equal(errors[0], errors[2])
    assert not np.allclose(errors[0], errors[1])


def test_the_size_of_the_image_does_not_change_what_is_seen():
    scene = fresh_scene()
    images = []
    for width in (320, 640):
        realism = dataclasses.replace(SMALL, width=width, height=width * 3 // 4)
        camera = RenderedCamera(scene.model, lambda: (0.0, scene.data.qpos), realism=realism)
        images.append(cv2.resize(camera.read().image, (80, 60), interpolation=cv2.INTER_AREA).astype(float))
        camera.close()
    assert np.abs(images[0] - images[1]).mean() < 3
