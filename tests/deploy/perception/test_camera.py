import time

import cv2
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.camera import (
    Camera,
    CameraError,
    UvcCamera,
)
from bt_jax.deploy.perception.opening import open_camera
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.tasks import load_task, task_names
from tests.helpers.rendered import PLACEMENT, TASK, fresh_scene


def film(path, count: int = 12) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 30, (64, 48))
    for i in range(count):
        writer.write(np.full((48, 64, 3), 20 * i, np.uint8))
    writer.release()


def test_a_film_is_a_camera_until_its_end(tmp_path):
    film(tmp_path / "film.avi")
    camera = UvcCamera(str(tmp_path / "film.avi"), np.eye(3), np.zeros(5), width=64, height=48)
    assert isinstance(camera, Camera)
    assert camera._newest[0].shape == (48, 64, 3)  # `read` may come too late: a film is read as fast as it goes
    camera._thread.join(timeout=5)
    with pytest.raises(CameraError, match="no more"):
        camera.read()
    camera.close()


class Capture:
    """A device that sends one image for ever."""

    def __init__(self, _) -> None:
        self.image = np.full((48, 64, 3), 100, np.uint8)

    def isOpened(self) -> bool:
        return True

    def set(self, *_) -> None: ...

    def release(self) -> None: ...

    def read(self):
        time.sleep(0.002)
        return True, self.image.copy()


def test_a_frozen_camera_grows_old(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    camera = UvcCamera(0, np.eye(3), np.zeros(5), width=64, height=48)
    first = camera.read().time
    time.sleep(0.05)
    assert camera.read().time == first
    camera._capture.image = np.full((48, 64, 3), 101, np.uint8)
    deadline = time.monotonic() + 5
    while camera.read().time == first and time.monotonic() < deadline:
        time.sleep(0.005)
    assert camera.read().time > first
    camera.close()


def test_a_camera_of_another_size_is_refused(tmp_path):
    film(tmp_path / "film.avi")
    with pytest.raises(UserError, match="64 x 48 instead of 640 x 480"):
        UvcCamera(str(tmp_path / "film.avi"), np.eye(3), np.zeros(5), width=640, height=480)


@pytest.mark.filterwarnings("ignore")
def test_no_camera_is_told(tmp_path):
    with pytest.raises(UserError, match="cannot be opened"):
        open_camera(str(tmp_path / "none.avi"), None)


def test_a_video_is_refused_with_a_remedy(tmp_path):
    film(tmp_path / "film.avi")
    with pytest.raises(UserError, match=r"film\.avi is a file, .*ffmpeg -i .*and give the folder"):
        open_camera(str(tmp_path / "film.avi"), None)


def test_rendered_images_freeze_and_are_lost():
    scene = fresh_scene()
    camera = RenderedCamera(scene.model, lambda: (scene.time, scene.data.qpos))
    assert isinstance(camera, Camera)
    first = camera.read()
    assert first.image.std() > 10
    np.testing.assert_allclose(first.matrix, PLACEMENT.matrix, rtol=1e-6)
    camera.freeze()
    scene.time += 1
    assert camera.read().time == first.time
    camera.lose()
    with pytest.raises(CameraError):
        camera.read()
    camera.close()


def test_a_covered_body_shows_no_markers_until_it_is_uncovered():
    scene = fresh_scene()
    camera = RenderedCamera(scene.model, lambda: (scene.time, scene.data.qpos))
    before = camera.read().image
    camera.cover("YellowBox")
    camera.cover("YellowBox")
    covered = camera.read().image
    assert np.any(covered != before)
    camera.uncover("YellowBox")
    np.testing.assert_array_equal(camera.read().image, before)
    camera.close()


@pytest.mark.parametrize("name", task_names())
def test_the_placed_camera_sees_every_table(name):
    task = load_task(name)
    camera = cell_camera(task)
    for table in task.tables:
        for x in (-0.5, 0.5):
            for y in (-0.5, 0.5):
                corner = [table.position[0] + x * table.size[0], table.position[1] + y * table.size[1], table.top]
                pixel = camera.matrix @ camera.pose.inv().apply(corner)
                assert pixel[2] > 0
                assert 0 < pixel[0] / pixel[2] < camera.width - 1
                assert 0 < pixel[1] / pixel[2] < camera.height - 1


def test_the_placed_camera_stands_across_the_tables_from_the_robot():
    position = cell_camera(TASK).pose.translation
    assert position[0] > max(table.position[0] + table.size[0] / 2 for table in TASK.tables)
    assert position[2] > 0.3
