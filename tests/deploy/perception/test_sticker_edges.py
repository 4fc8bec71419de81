"""The white edge of a sticker looks like a marker that is a little too large, in some light and at some angles."""

import numpy as np

from bt_jax.deploy.perception.detection import Detector
from bt_jax.deploy.perception.markers import task_markers
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.demonstrator import Demonstrator
from bt_jax.deploy.twin.filmed import FilmedDemonstration
from bt_jax.deploy.twin.settings import Realism
from bt_jax.tasks import load_task

TASK = load_task("yumi_stack")
SEED = [1 << 22, 11, 1, 0]  # of a layout in which the edge of BlueBox's sticker was read, and the box taken for two


def test_the_edge_of_a_sticker_is_not_read_as_its_marker():
    scene = build_scene(YUMI, TASK, SEED, Realism())
    person = Demonstrator(scene, TASK.targets, np.random.default_rng(SEED))
    camera = FilmedDemonstration(scene, person, fps=4.0, placement=scene.camera, seed=SEED)
    detector = Detector(task_markers(TASK))
    try:
        for _ in range(4):
            frame = camera.read()
            picture = detector.look(frame.image, frame.matrix, frame.distortion)
            assert picture.apart == ()
            assert "BlueBox" in {detection.body for detection in picture.detections}
    finally:
        camera.close()
