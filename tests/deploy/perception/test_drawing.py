import numpy as np

from bt_jax.deploy.perception.camera import CameraFrame
from bt_jax.deploy.perception.detection import Detector
from bt_jax.deploy.perception.drawing import draw_detections
from bt_jax.deploy.perception.markers import task_markers
from tests.helpers.rendered import KIT, PLACEMENT, TASK, fresh_scene, upright


def test_outlines_are_around_what_was_detected_and_names_do_not_cover_each_other():
    scene = fresh_scene()
    scene.put("YellowBox", upright(0.3, 0.24))
    scene.put("GreenBox", upright(0.3, 0.18))
    image = scene.image()
    frame = CameraFrame(image, 0.0, PLACEMENT.matrix, np.zeros(5))
    found = Detector(task_markers(TASK))(image, PLACEMENT.matrix, np.zeros(5))
    assert {"YellowBox", "GreenBox", KIT} <= {one.body for one in found}
    drawn = draw_detections(frame, found, TASK)
    changed = np.any(drawn != image, axis=2)
    for one in found:
        x, y, depth = PLACEMENT.matrix @ one.pose.translation
        column, row = round(x / depth), round(y / depth)
        if one.body != KIT:
            assert not changed[row - 3 : row + 4, column - 3 : column + 4].any()  # what is inside stays as it is
        assert changed[row - 80 : row + 80, column - 80 : column + 80].any()
    alone = [np.any(draw_detections(frame, [one], TASK) != image, axis=2).sum() for one in found]
    assert changed.sum() > 0.85 * sum(alone)
    assert np.array_equal(draw_detections(frame, [], TASK), image)
