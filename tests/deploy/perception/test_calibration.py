import os

os.environ.setdefault("MUJOCO_GL", "egl")

import cv2
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import CalibrateArguments
from bt_jax.deploy.commands.calibrate import calibrate_command
from bt_jax.deploy.perception.calibration import (
    Intrinsics,
    alike,
    calibrate_lens,
    charuco_board,
    locate_camera,
)
from bt_jax.deploy.perception.camera_file import load_camera, load_intrinsics, save_camera
from bt_jax.deploy.perception.markers import task_markers
from tests.helpers.rendered import PLACEMENT, TASK, fresh_scene

LENS = Intrinsics(
    np.array([[600.0, 0, 322], [0, 598, 236], [0, 0, 1]]), np.array([-0.2, 0.05, 0.001, -0.0005, 0]), 640, 480, 0.1
)
POSE = RigidTransform.from_components([0.7, 0.02, 0.55], Rotation.from_quat([0.653, 0.653, -0.271, -0.271]))


def views_of_the_board(count: int, noise: float = 0.05, turn: float = 0.5):
    """Corners of the board as the lens would show them from random sides."""
    rng, board = np.random.default_rng(0), charuco_board()
    points = np.asarray(board.getChessboardCorners(), np.float32)
    for _ in range(count):
        rotation = Rotation.from_euler("xyz", turn * rng.uniform(-1, 1, 3)).as_rotvec()
        place = np.array([-0.09, -0.12, 0.0]) + rng.uniform([-0.08, -0.05, 0.4], [0.08, 0.05, 0.7])
        pixels = cv2.projectPoints(points, rotation, place, LENS.matrix, LENS.distortion)[0].reshape(-1, 2)
        yield points, (pixels + rng.normal(0, noise, pixels.shape)).astype(np.float32)


def drawn_board(turn, place) -> np.ndarray:
    """An image of the board through a lens without distortion: its print, seen in perspective."""
    board, scale = charuco_board(), 2000
    size = np.array(board.getChessboardSize()) * 0.035
    image = board.generateImage(tuple((size * scale).astype(int)), marginSize=0)
    rotation = Rotation.from_rotvec(turn).as_matrix()
    flat = LENS.matrix @ np.column_stack([rotation[:, 0], rotation[:, 1], place])
    to_metres = np.array([[1 / scale, 0, 0.5 / scale], [0, 1 / scale, 0.5 / scale], [0, 0, 1]])
    return cv2.warpPerspective(image, flat @ to_metres, (640, 480), flags=cv2.INTER_AREA, borderValue=200)


def test_the_lens_is_recovered():
    lens, errors = calibrate_lens(list(views_of_the_board(15)), 640, 480)
    assert lens.error < 0.1
    assert errors.max() < 0.15
    np.testing.assert_allclose(lens.matrix, LENS.matrix, atol=3)


def test_too_few_views_are_refused():
    with pytest.raises(UserError, match="take more"):
        calibrate_lens(list(views_of_the_board(3)), 640, 480)


def test_the_command_calibrates_from_pictures(tmp_path, capsys):
    rng = np.random.default_rng(1)
    for i in range(10):
        turn = Rotation.from_euler("xyz", rng.uniform(-0.45, 0.45, 3)).as_rotvec()
        place = np.array([-0.09, -0.12, 0.45]) + rng.uniform([-0.05, -0.03, 0], [0.05, 0.03, 0.2])
        cv2.imwrite(str(tmp_path / f"{i}.png"), drawn_board(turn, place))
    file = tmp_path / "camera.yaml"
    assert calibrate_command(CalibrateArguments("intrinsics", camera=str(tmp_path), file=file)) == 0
    lens = load_intrinsics(file)
    assert lens.error < 0.5
    assert lens.matrix[0, 0] == pytest.approx(600, rel=0.02)
    assert (lens.width, lens.height) == (640, 480)
    assert "residual" in capsys.readouterr().out


def test_views_alike_count_once():
    views = list(views_of_the_board(8))
    lens, errors = calibrate_lens([*views, *views, views[0]], 640, 480)
    alone, expected = calibrate_lens(views, 640, 480)
    np.testing.assert_allclose(lens.matrix, alone.matrix, rtol=1e-6)
    np.testing.assert_allclose(errors, expected, rtol=1e-4)
    with pytest.raises(UserError, match=r"from 2 of the 6 sides .*5 more are like others.* turned and at other"):
        calibrate_lens([*views[:2], *[views[1]] * 5], 640, 480)


@pytest.mark.parametrize(("turn", "noise"), [(0.0, 0.3), (0.03, 0.05), (0.03, 0.3), (0.1, 0.3)])
def test_a_lens_that_the_views_leave_open_is_refused(turn, noise):
    """All of them look straight down on the board: many focal lengths explain them, with a small residual."""
    with pytest.raises(UserError, match=r"leave the focal length open by .* turned by 20 to 40 degrees"):
        calibrate_lens(list(views_of_the_board(12, noise, turn)), 640, 480)


def test_noisy_pictures_of_a_board_that_was_turned_are_to_be_sharper():
    with pytest.raises(UserError, match=r"open by \d\.\d\d% .* 1% is needed; take more and sharper pictures$"):
        calibrate_lens(list(views_of_the_board(8, noise=0.3)), 640, 480)


def test_views_that_share_few_corners_are_not_alike():
    points, pixels = next(views_of_the_board(1))
    few, many = slice(0, 14), slice(10, 24)  # four corners in common, on the same place
    assert alike((points, pixels), (points[many], pixels[many]), 640)
    assert not alike((points[few], pixels[few]), (points[many], pixels[many]), 640)


def test_corners_that_coincide_are_refused():
    points = next(views_of_the_board(1))[0]
    with pytest.raises(UserError, match="no lens explains the pictures; take others"):
        calibrate_lens([(points, np.full((24, 2), 40.0 * i, np.float32)) for i in range(7)], 640, 480)


def test_pictures_that_no_lens_explains_are_refused():
    with pytest.raises(UserError, match=r"explains the pictures to .* flat"):
        calibrate_lens(list(views_of_the_board(15, noise=2.0)), 640, 480)


def test_a_place_that_the_markers_contradict_is_not_written(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), cv2.cvtColor(fresh_scene().image(), cv2.COLOR_RGB2BGR))
    file, known, scene = tmp_path / "camera.yaml", tmp_path / "points.yaml", fresh_scene()
    save_camera(file, Intrinsics(PLACEMENT.matrix, np.zeros(5), 640, 480, 0.1))
    before, rng = file.read_bytes(), np.random.default_rng(0)
    centres = {
        marker.id: ((scene.truth(marker.body) * marker.pose).translation + rng.normal(0, 0.02, 3)).tolist()
        for marker in task_markers(TASK)
    }
    known.write_text(yaml.safe_dump(centres))
    with pytest.raises(
        UserError, match=r"disagree by .* mm, and 5 mm is needed; measure again .* and check that they are metres"
    ):
        calibrate_command(CalibrateArguments("base", camera=str(tmp_path), file=file, points=known))
    assert file.read_bytes() == before


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_the_place_is_recovered(noise):
    rng = np.random.default_rng(2)
    points = rng.uniform([0.2, -0.3, 0], [0.4, 0.3, 0.15], (8, 3))
    seen = POSE.inv()
    pixels = cv2.projectPoints(points, seen.rotation.as_rotvec(), seen.translation, LENS.matrix, LENS.distortion)[0]
    pixels = pixels.reshape(-1, 2) + rng.normal(0, 1, (8, 2)) * noise
    place, distances = locate_camera(points, pixels, LENS)
    assert len(distances) == place.points == 8
    if noise:
        assert 0 < place.residual < 0.001
    else:
        assert place.residual < 1e-6
    np.testing.assert_allclose(place.pose.translation, POSE.translation, atol=1e-6 if not noise else 0.01)
    assert (place.pose.rotation.inv() * POSE.rotation).magnitude() < (1e-6 if not noise else 0.01)


def test_a_wrong_point_shows_in_the_residual():
    rng = np.random.default_rng(3)
    points = rng.uniform([0.2, -0.3, 0], [0.4, 0.3, 0.15], (8, 3))
    seen = POSE.inv()
    pixels = cv2.projectPoints(points, seen.rotation.as_rotvec(), seen.translation, LENS.matrix, LENS.distortion)[0]
    points[2] += [0.0, 0.03, 0.0]
    place, _ = locate_camera(points, pixels.reshape(-1, 2), LENS)
    assert place.residual > 0.003


@pytest.mark.parametrize("points", [np.zeros((3, 3)), np.outer(np.arange(5.0), [0.1, 0.2, 0.0])])
def test_points_that_do_not_tell_are_refused(points):
    with pytest.raises(UserError, match=r"needed|line"):
        locate_camera(points, np.zeros((len(points), 2)), LENS)


def test_the_command_locates_the_camera_of_the_scene(tmp_path, capsys):
    scene = fresh_scene()
    cv2.imwrite(str(tmp_path / "0.png"), cv2.cvtColor(scene.image(), cv2.COLOR_RGB2BGR))
    file, known = tmp_path / "camera.yaml", tmp_path / "points.yaml"
    save_camera(file, Intrinsics(PLACEMENT.matrix, np.zeros(5), 640, 480, 0.1))
    centres = {
        marker.id: (scene.truth(marker.body) * marker.pose).translation.tolist() for marker in task_markers(TASK)
    }
    known.write_text(yaml.safe_dump(centres))
    assert calibrate_command(CalibrateArguments("base", camera=str(tmp_path), file=file, points=known)) == 0
    _, place = load_camera(file)
    assert place.points >= 6
    assert place.residual < 0.001
    assert np.linalg.norm(place.pose.translation - PLACEMENT.pose.translation) < 0.005
    assert "residual" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"step": "intrinsics", "square": 35.0}, "metres"),
        ({"step": "intrinsics"}, "no pictures"),
        ({"step": "base"}, "--points"),
        ({"step": "base", "points": "bad"}, "one line"),
    ],
)
def test_bad_arguments_are_told(tmp_path, arguments, message):
    save_camera(tmp_path / "camera.yaml", LENS)
    (tmp_path / "bad").write_text("3: [1, 2]")
    if "points" in arguments:
        arguments = {**arguments, "points": tmp_path / arguments["points"]}
    with pytest.raises(UserError, match=message):
        calibrate_command(CalibrateArguments(camera=str(tmp_path), file=tmp_path / "camera.yaml", **arguments))
