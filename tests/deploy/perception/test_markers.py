import dataclasses

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.markers import MODULES, marker_image, task_markers
from bt_jax.tasks import load_task, task_names
from tests.helpers.rendered import KIT, TASK


@pytest.mark.parametrize("name", task_names())
def test_every_marker_is_unique_and_lies_on_its_body(name):
    task = load_task(name)
    markers = task_markers(task)
    assert len({marker.id for marker in markers}) == len(markers)
    for marker in markers:
        outward = marker.axes[:, 2]
        assert np.linalg.det(marker.axes) == pytest.approx(1)
        if marker.body == task.kit.name:
            corners = np.abs(marker.corners)
            assert corners[:, :2].max() < task.kit.inner[0]
            assert corners[:, 2] == pytest.approx(task.kit.thickness / 2)
        else:
            edge = next(box.edge for box in task.objects if box.name == marker.body)
            assert marker.corners @ outward == pytest.approx(edge / 2)
            assert marker.sticker == pytest.approx(edge)
        assert np.linalg.norm(marker.corners[1] - marker.corners[0]) == pytest.approx(marker.size)


def test_stickers_in_the_kit_leave_its_middle_free():
    edge = max(box.edge for box in TASK.objects)
    for marker in task_markers(TASK):
        if marker.body == KIT:
            nearest = np.abs(marker.pose.translation[:2]) - marker.sticker / 2
            assert nearest.max() > edge / 2


def test_faces_have_the_axes_of_a_cube_texture():
    axes = {marker.face: marker.axes[:, 2] for marker in task_markers(TASK)[:6]}
    x, y, z = np.eye(3)
    expected = {"right": x, "left": -x, "up": y, "down": -y, "front": z, "back": -z}
    for face, outward in expected.items():
        np.testing.assert_allclose(axes[face], outward, atol=1e-12)


def test_the_image_is_a_marker_in_a_bright_margin():
    image = marker_image(7, 2, 5)
    assert image.shape == ((MODULES + 4) * 5,) * 2
    assert (image[:10] == 255).all()
    assert (image[10:15, 10:-10] == 0).all()


def test_too_many_boxes_are_refused():
    boxes = tuple(dataclasses.replace(TASK.objects[0], name=f"Box{i}") for i in range(8))
    with pytest.raises(UserError, match="at most 7 boxes"):
        task_markers(dataclasses.replace(TASK, objects=boxes))
