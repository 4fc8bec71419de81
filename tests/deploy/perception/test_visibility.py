"""Which markers must be seen, by what stands where."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from bt_jax.deploy.perception.detection import Detector
from bt_jax.deploy.perception.markers import task_markers
from bt_jax.deploy.perception.visibility import visible_markers
from tests.helpers.rendered import KIT, PLACEMENT, TASK, TOP, fresh_scene, upright

EYE = PLACEMENT.pose
NUMBERS = {(marker.body, marker.face): marker.id for marker in task_markers(TASK)}
TABLES = [upright(0.3, 0.24), upright(0.3, -0.24), upright(0.25, -0.2)]


def visible(**poses):
    placed = dict(zip(TASK.object_names, TABLES, strict=True)) | {
        KIT: RigidTransform.from_translation([0.3, 0, TOP + 0.001])
    }
    return visible_markers(TASK, placed | poses, EYE)


def faces(found, body):
    return {face for (name, face), number in NUMBERS.items() if name == body and number in found[body]}


def test_a_box_alone_shows_its_top_and_the_side_towards_the_camera():
    found = visible()
    assert {"front", "right"} <= faces(found, "YellowBox")
    assert not {"back", "left"} & faces(found, "YellowBox")
    assert faces(found, KIT) == {"left_back", "left_front"}  # the wall before the others hides their feet


def test_a_box_on_top_hides_the_top_and_one_in_front_the_side():
    on_top = visible(GreenBox=upright(0.3, 0.24, z=TOP + 0.06))
    assert "front" not in faces(on_top, "YellowBox")
    assert "right" in faces(on_top, "YellowBox")
    before = visible(GreenBox=upright(0.345, 0.24))
    assert faces(before, "YellowBox") == {"front"}


def test_a_box_in_the_kit_hides_a_marker_of_the_kit():
    assert faces(visible(YellowBox=upright(0.26, 0.05, z=TOP + 0.022)), KIT) == {"left_front"}


def test_the_wall_of_the_kit_hides_the_foot_of_what_stands_behind_it():
    assert "right" not in faces(visible(YellowBox=upright(0.357, 0.0, z=TOP + 0.022)), "YellowBox")


def test_what_must_be_seen_is_what_is_detected_in_a_rendered_scene():
    scene = fresh_scene()
    frame = scene.camera.read()
    detected = {
        one.body: set(one.markers) for one in Detector(task_markers(TASK))(frame.image, frame.matrix, np.zeros(5))
    }
    poses = {name: scene.truth(name) for name in (*TASK.object_names, KIT)}
    for body, markers in visible_markers(TASK, poses, EYE).items():
        assert markers.keys() <= detected[body], body
