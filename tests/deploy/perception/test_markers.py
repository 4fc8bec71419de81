import dataclasses

import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.markers import MODULES, marker_dictionary, marker_image, task_markers
from bt_jax.tasks import Task, load_task, task_names
from tests.helpers.rendered import KIT, TASK

MARKED = [name for name in task_names() if name != "yumi_kit12"]  # one of its trays has no room for a marker


@pytest.mark.parametrize("name", MARKED)
def test_every_marker_is_unique_and_lies_on_its_body(name):
    task = load_task(name)
    markers = task_markers(task)
    assert len({marker.id for marker in markers}) == len(markers)
    for marker in markers:
        outward = marker.axes[:, 2]
        assert np.linalg.det(marker.axes) == pytest.approx(1)
        if marker.body in task.kit_names:
            kit = task.kits[task.kit_names.index(marker.body)]
            assert np.all(np.abs(marker.corners)[:, :2] < kit.inner)
            assert marker.corners[:, 2] == pytest.approx(kit.plate)
        else:
            thing = task.thing(marker.body)
            deep = np.abs(outward) @ thing.size
            assert marker.corners @ outward == pytest.approx(deep / 2)
            face = [edge for edge, along in zip(thing.size, np.abs(outward), strict=True) if along < 0.5]
            assert marker.sticker == pytest.approx(min(face))
        assert np.linalg.norm(marker.corners[1] - marker.corners[0]) == pytest.approx(marker.size)


def test_stickers_in_the_kit_leave_its_middle_free():
    edge = max(box.edge for box in TASK.objects)
    for marker in task_markers(TASK):
        if marker.body == KIT:
            nearest = np.abs(marker.pose.translation[:2]) - marker.sticker / 2
            assert nearest.max() > edge / 2


@pytest.mark.parametrize("name", MARKED)
def test_stickers_of_a_kit_with_slots_lie_apart_and_beside_its_walls_and_what_it_holds(name):
    task = load_task(name)
    for kit in (kit for kit in task.kits if kit.places):
        targets = [target for target in task.targets if target.frame == kit.name]
        areas = [(target.position, task.thing(target.object).half_at(target.turn)) for target in targets]
        areas += kit.walls()
        for marker in task_markers(task):
            if marker.body != kit.name:
                continue
            own = marker.pose.translation, (marker.sticker / 2,) * 2
            assert not any(overlap(own, area) for area in areas)
            areas.append(own)


def test_a_kit_without_room_for_a_marker_is_refused():
    task = load_task("yumi_kit12")
    with pytest.raises(
        UserError, match=r"TrayB leaves no room for markers beside its slots.* or leave out its dividers"
    ):
        task_markers(task)
    tray, dense = task.kits
    for remedy in ({"size": (0.24, 0.06)}, {"dividers": False}):
        kits = (tray, dataclasses.replace(dense, **remedy))
        assert any(marker.body == "TrayB" for marker in task_markers(dataclasses.replace(task, kits=kits)))


def overlap(one, other):
    return all(abs(one[0][i] - other[0][i]) < one[1][i] + other[1][i] - 1e-9 for i in (0, 1))


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


def boxes(count: int) -> Task:
    return dataclasses.replace(
        TASK, objects=tuple(dataclasses.replace(TASK.objects[0], name=f"Box{i}") for i in range(count))
    )


def test_more_markers_than_a_dictionary_has_are_of_the_next_and_the_first_ones_stay():
    assert len(task_markers(boxes(16))) == 100
    np.testing.assert_array_equal(marker_dictionary(100).bytesList[:50], marker_dictionary().bytesList)
    with pytest.raises(UserError, match=r"need 256 markers.*use fewer objects"):
        task_markers(boxes(42))
