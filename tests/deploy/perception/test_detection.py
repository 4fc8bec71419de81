import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.detection import Detector
from bt_jax.deploy.perception.markers import marker_image, task_markers
from tests.helpers.rendered import KIT, PLACEMENT, TASK, TOP, errors, fresh_scene, upright

MATRIX, NO_DISTORTION = PLACEMENT.matrix, np.zeros(5)


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector(task_markers(TASK))


def located(detector, image, matrix=MATRIX, distortion=NO_DISTORTION) -> dict[str, RigidTransform]:
    return {found.body: PLACEMENT.pose * found.pose for found in detector(image, matrix, distortion)}


def test_random_poses_are_found_with_the_right_identity_and_place(detector):
    rng, scene = np.random.default_rng(0), fresh_scene()
    distances, angles = [], []
    for _ in range(12):
        for name, y in zip(TASK.object_names, (0.24, -0.17, -0.27), strict=True):
            face = Rotation.from_euler("xyz", rng.integers(0, 4, 3) * np.pi / 2)
            place = upright(0.3 + rng.uniform(-0.05, 0.05), y + rng.uniform(-0.02, 0.02), turn=rng.uniform(-3, 3))
            scene.put(name, RigidTransform.from_components(place.translation, place.rotation * face))
        found = located(detector, scene.image())
        for name in (*TASK.object_names, KIT):
            distance, angle = errors(scene.truth(name), found[name])
            distances.append(distance)
            angles.append(angle)
    assert np.median(distances) < 0.5
    assert np.median(angles) < 0.2
    assert max(distances) < 5
    assert max(angles) < 2


@pytest.mark.parametrize("face", range(6))
def test_every_face_is_read_the_right_way_round(detector, face):
    turns = ["", "x", "xx", "xxx", "y", "yyy"][face]
    rotation = Rotation.identity()
    for axis in turns:
        rotation = Rotation.from_euler(axis, np.pi / 2) * rotation
    scene = fresh_scene()
    scene.put(
        "YellowBox", RigidTransform.from_components([0.3, 0.2, TOP + 0.02], Rotation.from_euler("z", 0.6) * rotation)
    )
    distance, angle = errors(scene.truth("YellowBox"), located(detector, scene.image())["YellowBox"])
    assert distance < 1
    assert angle < 1


def test_noise_does_not_spoil_it(detector):
    rng, scene = np.random.default_rng(1), fresh_scene()
    image = np.clip(scene.image() + rng.normal(0, 4, (480, 640, 3)), 0, 255).astype(np.uint8)
    found = located(detector, image)
    for name in TASK.object_names:
        distance, angle = errors(scene.truth(name), found[name])
        assert distance < 1.5
        assert angle < 1


@pytest.mark.parametrize("blur", [0.7, 1.0])
def test_a_soft_picture_pulls_nothing_towards_the_camera_and_says_how_soft_it_is(detector, blur):
    rng, scene = np.random.default_rng(3), fresh_scene()
    image = cv2.GaussianBlur(scene.image(), (0, 0), blur) + rng.normal(0, 2, (480, 640, 3))
    found = detector(np.clip(image, 0, 255).astype(np.uint8), MATRIX, NO_DISTORTION)
    assert {detection.body for detection in found} == {*TASK.object_names, KIT}
    for detection in found:
        distance, angle = errors(scene.truth(detection.body), PLACEMENT.pose * detection.pose)
        assert distance < 1
        assert angle < 0.5
        assert detection.blur == pytest.approx(blur, abs=0.15)


def test_distortion_is_taken_out(detector):
    scene, lens = fresh_scene(), np.array([-0.25, 0.08, 0.001, -0.001, 0.0])
    grid = np.stack(np.meshgrid(np.arange(640.0), np.arange(480.0)), axis=-1).reshape(-1, 1, 2)
    straight = cv2.undistortPoints(grid, MATRIX, lens, P=MATRIX).reshape(480, 640, 2).astype(np.float32)
    image = cv2.remap(scene.image(), straight[..., 0], straight[..., 1], cv2.INTER_CUBIC)
    found = located(detector, image, distortion=lens)
    for name in TASK.object_names:
        distance, angle = errors(scene.truth(name), found[name])
        assert distance < 1.5
        assert angle < 1


def test_a_covered_box_is_not_found_and_the_others_are(detector):
    scene = fresh_scene()
    place = scene.truth("BlueBox").translation
    eye = PLACEMENT.pose.translation
    scene.put("cover", RigidTransform.from_components(place + 0.12 * (eye - place), PLACEMENT.pose.rotation))
    scene.model.geom_size[-1, :2] = 0.06
    try:
        found = located(detector, scene.image())
    finally:
        scene.model.geom_size[-1, :2] = 0.015
    assert "BlueBox" not in found
    assert {"YellowBox", "GreenBox", KIT} <= set(found)


def test_a_marker_half_covered_does_not_move_its_box(detector):
    scene = fresh_scene()
    place = scene.truth("BlueBox")
    scene.put(
        "cover", RigidTransform.from_components(place.translation + np.array([0, 0.012, 0.023]), Rotation.identity())
    )
    found = located(detector, scene.image())
    if "BlueBox" in found:
        distance, angle = errors(place, found["BlueBox"])
        assert distance < 2
        assert angle < 2


@pytest.mark.parametrize("across", [-0.018, -0.012, 0.012, 0.018])
@pytest.mark.parametrize("height", [0.024, 0.04])
def test_a_box_known_keeps_its_place_while_something_comes_over_it(detector, across, height):
    """As a hand does: points that are covered must not pull the pose away."""
    scene, to_camera = fresh_scene(), PLACEMENT.pose.inv()
    worst = 0.0
    for name in TASK.object_names:
        place = scene.truth(name)
        scene.put("cover", RigidTransform.from_translation(place.translation + np.array([0.0, across, height])))
        seen = detector(scene.image(), MATRIX, NO_DISTORTION, {name: to_camera * place})
        for detection in seen:
            if detection.body == name and len(detection.markers) > 1:
                worst = max(worst, errors(place, PLACEMENT.pose * detection.pose)[0])
    assert 0 < worst < 1.2


def test_the_standard_deviation_tells_how_much_one_face_is_worth(detector):
    scene = fresh_scene()
    found = {d.body: d for d in detector(scene.image(), MATRIX, NO_DISTORTION)}
    for name in TASK.object_names:
        place = scene.truth(name)
        scene.put("cover", RigidTransform.from_translation(place.translation + np.array([0.0, 0.0, 0.023])))
        one = next(d for d in detector(scene.image(), MATRIX, NO_DISTORTION) if d.body == name)
        if len(one.markers) < len(found[name].markers):
            assert one.sigma > found[name].sigma


def test_a_foreign_marker_is_outvoted(detector):
    """A marker of the yellow box's underside lies about elsewhere."""
    scene = fresh_scene()
    image = scene.image().copy()
    underside = next(m.id for m in task_markers(TASK) if m.body == "YellowBox" and m.face == "back")
    paper = marker_image(underside, 1, 6)
    image[400 : 400 + len(paper), 300 : 300 + len(paper)] = paper[:, :, None]
    assert detector.look(image, MATRIX, NO_DISTORTION).apart == ("YellowBox",)
    distance, angle = errors(scene.truth("YellowBox"), located(detector, image)["YellowBox"])
    assert distance < 2
    assert angle < 2


def test_a_copied_marker_leaves_its_box_unknown(detector):
    image, number = with_a_copy(fresh_scene().image(), "YellowBox", detector)
    picture = detector.look(image, MATRIX, NO_DISTORTION)
    assert picture.repeated == (number,)
    assert {detection.body for detection in picture.detections} == {"GreenBox", "BlueBox", KIT}


def test_a_sheet_with_another_marker_of_a_box_is_told_from_the_box(detector):
    """None of its markers is seen twice, but they contradict each other."""
    scene = fresh_scene()
    clean = {found.body: found for found in detector(scene.image(), MATRIX, NO_DISTORTION)}
    others = [m.id for m in task_markers(TASK) if m.body == "BlueBox" and m.id not in clean["BlueBox"].markers]
    image = scene.image().copy()
    for place, number in enumerate(others[:3]):
        paper = marker_image(number, 1, 6)
        image[400 : 400 + len(paper), 180 + 80 * place : 180 + 80 * place + len(paper)] = paper[:, :, None]
    picture = detector.look(image, MATRIX, NO_DISTORTION)
    assert picture.apart == ("BlueBox",)
    assert "BlueBox" not in {detection.body for detection in picture.detections}


def with_a_copy(image: np.ndarray, body: str, detector: Detector) -> tuple[np.ndarray, int]:
    """The image with the best seen marker of a body once more, and the marker's id."""
    detection = next(d for d in detector(image, MATRIX, NO_DISTORTION) if d.body == body)
    markers = [m for m in task_markers(TASK) if m.id in detection.markers]
    areas = {}
    for marker in markers:
        points = detection.pose.apply(marker.place(np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]]) * marker.sticker / 2))
        pixels = points[:, :2] / points[:, 2:] * MATRIX[0, 0] + MATRIX[:2, 2]
        areas[marker.id] = (np.abs(np.linalg.det([pixels[1] - pixels[0], pixels[3] - pixels[0]])), pixels)
    number = max(areas, key=lambda n: areas[n][0])
    (left, top), (right, bottom) = areas[number][1].min(axis=0), areas[number][1].max(axis=0) + 1
    copied, image = image[int(top) : int(bottom), int(left) : int(right)], image.copy()
    image[400 : 400 + len(copied), 300 : 300 + copied.shape[1]] = copied
    return image, number


@pytest.mark.parametrize("image", [np.zeros((480, 640, 3), np.uint8), np.full((480, 640), 255, np.uint8)])
def test_nothing_is_seen_in_an_empty_image(detector, image):
    assert detector(image, MATRIX, NO_DISTORTION) == []


def test_noise_holds_no_boxes(detector):
    rng = np.random.default_rng(2)
    for _ in range(5):
        coarse = rng.integers(0, 2, (60, 80), np.uint8) * 255
        assert detector(np.kron(coarse, np.ones((8, 8), np.uint8)), MATRIX, NO_DISTORTION) == []


def test_a_start_without_an_answer_is_left_out(detector, monkeypatch):
    """OpenCV answers with NaN for some quads."""
    solve = cv2.solvePnPGeneric

    def with_nan(*args, **kwargs):
        found, rotations, positions, rest = solve(*args, **kwargs)
        return found, [np.full((3, 1), np.nan), *rotations[1:]], positions, rest

    scene = fresh_scene()
    monkeypatch.setattr(cv2, "solvePnPGeneric", with_nan)
    for detection in detector(scene.image(), MATRIX, NO_DISTORTION):
        assert np.isfinite(detection.pose.as_matrix()).all()
