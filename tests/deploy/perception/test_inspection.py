"""What perception says is wrong with what it sees; and that it says nothing where nothing is wrong."""

import dataclasses

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax.deploy.perception.camera import CameraFrame
from bt_jax.deploy.perception.camera_check import camera_shift
from bt_jax.deploy.perception.markers import marker_image, task_markers
from bt_jax.deploy.perception.pipeline import Perception
from tests.helpers.rendered import KIT, PLACEMENT, TASK, TOP, fresh_scene, upright

PLATE = TASK.kits[0].thickness


class Looking:
    """Perception of the marked scene, of images that `change` may spoil, by a camera believed to be at `pose`."""

    def __init__(self, change=lambda image: image, pose: RigidTransform = PLACEMENT.pose) -> None:
        self.scene, self.change = fresh_scene(), change
        self.perception = Perception(TASK, self, pose)

    def read(self) -> CameraFrame:
        frame = self.scene.camera.read()
        return dataclasses.replace(frame, image=self.change(frame.image))

    def close(self) -> None:
        """Nothing is opened."""

    def findings(self, images: int = 8) -> dict[str, str]:
        for _ in range(images):
            self.scene.time += 0.1
            self.perception.update()
        return {finding.about: finding.text for finding in self.perception.findings(self.scene.time)}

    def known(self) -> dict[str, RigidTransform]:
        return self.perception.poses(self.scene.time)


def moved(by=(0.0, 0.0, 0.0), turned=(0.0, 0.0, 0.0)) -> RigidTransform:
    """Where a camera is believed to be that was moved [m] and turned [deg] since."""
    turn = Rotation.from_rotvec(-np.radians(turned))
    return RigidTransform.from_components(PLACEMENT.pose.translation - by, turn * PLACEMENT.pose.rotation)


def noisy(image: np.ndarray) -> np.ndarray:
    soft = cv2.GaussianBlur(image, (0, 0), 0.7) + np.random.default_rng(int(image.sum())).normal(0, 3, image.shape)
    return np.clip(soft, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("level", ["apart", "stacked in the kit"])
def test_nothing_is_said_where_nothing_is_wrong(level):
    looking = Looking(noisy, moved((0.0, 0.0, 0.0015), (0.0, 0.15, 0.0)))
    if level != "apart":
        foot = looking.scene.truth(KIT).translation[2] + PLATE / 2
        for at, name in enumerate(TASK.object_names):
            looking.scene.put(name, upright(0.3, 0.0, turn=0.5 * at, z=foot + 0.02 + 0.04 * at))
    assert looking.findings() == {}


def test_nothing_is_said_of_what_is_over_in_a_moment():
    looking = Looking()
    looking.findings()
    place = looking.scene.truth("BlueBox").translation
    looking.scene.put("cover", upright(*place[:2], z=place[2] + 0.03))
    assert looking.findings(2) == {}


@pytest.mark.parametrize("blur", [1.5, 4.0])
def test_a_soft_picture_is_told_whether_markers_are_still_read_or_not(blur):
    said = Looking(lambda image: cv2.GaussianBlur(image, (0, 0), blur)).findings()[""]
    assert said.startswith("the picture is too soft (blur of ")
    assert said.endswith("): focus the lens, or clean it")


@pytest.mark.parametrize(("gain", "said"), [(2.5, "too bright: expose less"), (0.08, "too dark: light the cell")])
def test_a_picture_without_light_or_with_too_much_is_told_and_no_camera_is_blamed(gain, said):
    looking = Looking(lambda image: np.clip(gain * image.astype(float), 0, 255).astype(np.uint8))
    assert f"the picture is {said}" in looking.findings()[""]
    assert all(finding.stops for finding in looking.perception.findings(looking.scene.time))


@pytest.mark.parametrize("gain", [0.3, 1.3])
def test_a_picture_that_is_only_darker_or_brighter_serves(gain):
    looking = Looking(lambda image: np.clip(gain * image.astype(float), 0, 255).astype(np.uint8))
    assert looking.findings() == {}
    assert set(looking.known()) == {*TASK.object_names, KIT}


@pytest.mark.parametrize("blur", [0.0, 0.7])
def test_a_picture_that_serves_is_not_called_soft(blur):
    assert Looking(lambda image: cv2.GaussianBlur(image, (0, 0), blur) if blur else image).findings() == {}


@pytest.mark.parametrize(
    ("pose", "said"),
    [
        (moved(by=(0, 0, 0.005)), "things seem 5 mm too low"),
        (moved(by=(0, 0, -0.005)), "things seem 5 mm too high"),
        (moved(turned=(1, 0, 0)), "slant by 1.0 degrees"),
        (moved(turned=(0, -1, 0)), "slant by 1.0 degrees"),
        (moved(by=(0, 0, 0.005), turned=(0, 1, 0)), "too low and slant by 1.0 degrees"),
    ],
)
def test_a_camera_that_was_moved_is_told(pose, said):
    looking = Looking(pose=pose)
    assert said in looking.findings()[""]
    assert "calibrate again" in looking.findings()[""]
    assert all(finding.stops for finding in looking.perception.findings(looking.scene.time))


@pytest.mark.parametrize("wrong", ["GreenBox", KIT])
def test_one_thing_at_a_wrong_height_is_not_the_cameras_fault(wrong):
    scene = fresh_scene()
    poses = {name: scene.truth(name) for name in (*TASK.object_names, KIT)}
    poses[wrong] = RigidTransform.from_translation([0, 0, 0.006]) * poses[wrong]
    assert camera_shift(TASK, poses) is None
    assert camera_shift(TASK, {wrong: poses[wrong]}) is None


def test_boxes_that_are_held_stacked_or_lean_do_not_count():
    scene = fresh_scene()
    poses = {name: scene.truth(name) for name in (*TASK.object_names, KIT)}
    poses["GreenBox"] = upright(*poses["YellowBox"].translation[:2], z=TOP + 0.066)
    poses["BlueBox"] = upright(0.3, -0.24, z=TOP + 0.15)
    assert camera_shift(TASK, poses) is None
    shifted = {name: RigidTransform.from_translation([0, 0, 0.005]) * pose for name, pose in poses.items()}
    assert camera_shift(TASK, shifted).height == pytest.approx(0.005, abs=1e-6)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_poses_that_are_no_numbers_blame_no_camera(number):
    poses = {name: RigidTransform.from_translation([0.3, 0.1, number]) for name in TASK.object_names}
    assert camera_shift(TASK, poses) is None


def test_a_marker_that_is_there_twice_is_named_and_its_box_unknown():
    looking = Looking()
    looking.findings()
    seen = next(d for d in looking.perception.detections if d.body == "GreenBox").markers

    def copied(image: np.ndarray) -> np.ndarray:
        paper = marker_image(seen[0], 2, 6)
        image = image.copy()
        image[400 : 400 + len(paper), 300 : 300 + len(paper)] = paper[:, :, None]
        return image

    looking.change = copied
    said = looking.findings(12)
    assert said["GreenBox"] == f"marker {seen[0]} is seen twice: GreenBox's markers are on two things"
    assert set(looking.known()) == {"YellowBox", "BlueBox", KIT}


def test_a_second_box_with_the_same_markers_is_told():
    looking = Looking()
    numbers = {m.id for m in task_markers(TASK) if m.body == "BlueBox"}
    for name in ("BlueBox", "YellowBox"):
        looking.scene.put(name, upright(0.3, 0.2 if name == "BlueBox" else -0.2, turn=0.4))
    clean = looking.scene.image()

    def doubled(image: np.ndarray) -> np.ndarray:
        """The half of the picture with the blue box on both sides: the camera looks along y = 0."""
        half = image.shape[1] // 2
        looking_at = clean[:, half:] if sees(clean[:, half:], numbers) else clean[:, :half]
        return np.ascontiguousarray(np.concatenate([looking_at, looking_at], axis=1))

    looking.change = doubled
    assert "BlueBox's markers are on two things" in looking.findings()["BlueBox"]
    assert "BlueBox" not in looking.known()


def sees(image: np.ndarray, numbers: set[int]) -> bool:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    ids = cv2.aruco.ArucoDetector(dictionary).detectMarkers(np.ascontiguousarray(image[..., 1]))[1]
    return ids is not None and bool(set(map(int, np.ravel(ids))) & numbers)


def test_something_unknown_on_a_box_is_told():
    looking = Looking()
    looking.findings()
    place = looking.scene.truth("GreenBox").translation
    looking.scene.put("cover", upright(*place[:2], z=place[2] + 0.023))
    assert looking.findings()["GreenBox"] == "something unknown is on GreenBox"
    assert "GreenBox" in looking.known()
    looking.scene.put("cover", upright(0, 0, z=9.0))
    assert looking.findings(1) == {}


def test_a_box_on_a_box_is_nothing_unknown_nor_is_a_box_that_is_not_seen():
    looking = Looking()
    place = looking.scene.truth("YellowBox")
    looking.scene.put("GreenBox", upright(*place.translation[:2], turn=0.3, z=place.translation[2] + 0.04))
    assert looking.findings() == {}
    looking.scene.put("GreenBox", upright(0.3, 0.0, z=-0.5))
    looking.scene.put("cover", upright(*place.translation[:2], z=place.translation[2] + 0.023))
    assert set(looking.findings(12)) == {"GreenBox"}  # it may be the green box that lies there


def test_a_box_that_is_taken_away_is_missing_where_it_was():
    looking = Looking()
    looking.findings()
    place = looking.scene.truth("GreenBox")
    looking.scene.put("GreenBox", upright(0.3, 0.0, z=-0.5))
    assert looking.findings() == {"GreenBox": "GreenBox is not seen where it was last"}
    (finding,) = looking.perception.findings(looking.scene.time)
    assert finding.missing
    assert not finding.stops
    assert all(np.linalg.norm(place.translation - point) < 0.03 for point in finding.sight[1:])


def test_a_box_that_is_moved_in_sight_is_not_missing():
    looking = Looking()
    looking.findings()
    looking.scene.put("GreenBox", upright(0.33, 0.1))
    for _ in range(8):
        assert looking.findings(1) == {}


def test_a_leaning_box_is_told_and_unknown():
    looking = Looking()
    place = looking.scene.truth("BlueBox")
    leaning = place.rotation * Rotation.from_euler("x", 25, degrees=True)
    looking.scene.put("BlueBox", RigidTransform.from_components(place.translation + np.array([0, 0, 0.006]), leaning))
    assert looking.findings() == {"BlueBox": "BlueBox is tilted by 25 degrees"}
    assert "BlueBox" not in looking.known()
