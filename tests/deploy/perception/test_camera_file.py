import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics
from bt_jax.deploy.perception.camera_file import load_camera, load_points, save_camera

LENS = Intrinsics(
    np.array([[600.0, 0, 322], [0, 598, 236], [0, 0, 1]]), np.array([-0.2, 0.05, 0.001, -0.0005, 0]), 640, 480, 0.1
)
POSE = RigidTransform.from_components([0.7, 0.02, 0.55], Rotation.from_quat([0.653, 0.653, -0.271, -0.271]))


def test_what_is_saved_is_loaded(tmp_path):
    file = tmp_path / "camera.yaml"
    save_camera(file, LENS, CameraPose(POSE, 0.0012, 7))
    lens, place = load_camera(file)
    np.testing.assert_array_equal(lens.matrix, LENS.matrix)
    np.testing.assert_array_equal(lens.distortion, LENS.distortion)
    np.testing.assert_allclose(place.pose.as_matrix(), POSE.as_matrix(), atol=1e-12)
    assert (place.residual, place.points, lens.error) == (0.0012, 7, 0.1)


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        (None, "calibrate"),
        ("{", "make the file again"),
        ("[]", "calibrate"),
        ("intrinsics: {matrix: [[1]]}", "calibrate"),
        (
            "intrinsics: {matrix: [[0, 0, 0], [0, 0, 0], [0, 0, 1]], distortion: [0], width: 60, height: 40, error_px: 0}",
            "again",
        ),
    ],
)
def test_bad_files_are_told(tmp_path, text, remedy):
    file = tmp_path / "camera.yaml"
    if text is not None:
        file.write_text(text)
    with pytest.raises(UserError, match=remedy):
        load_camera(file)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("width: 640", "width: 6.4", r"intrinsics.width: expected a whole number"),
        ("width: 640", "width: true", r"intrinsics.width: expected a whole number"),
        ("width: 640", "width: 320", r"intrinsics.matrix: its centre is not in the image"),
        ("- [600.0, 0.0, 322.0]", "- [.nan, 0.0, 322.0]", r"intrinsics.matrix\[0\]\[0\]: expected a number"),
        ("- [600.0, 0.0, 322.0]", "- [600.0, 322.0]", r"intrinsics.matrix\[0\]: expected three numbers"),
        ("- [600.0, 0.0, 322.0]", "- [600.0, 0.0, -322.0]", r"intrinsics.matrix\[0\]\[2\]: -322 is implausible"),
        ("- [600.0, 0.0, 322.0]", "- [600.0, 5.0, 322.0]", r"intrinsics.matrix: it is not of the form"),
        ("distortion: [", "distortion: [1.0, ", r"6 coefficients"),
        ("error_px: 0.1", "error_px: -0.1", r"error_px: -0.1 is implausible"),
        ("error_px: 0.1", "error_px: .nan", r"error_px: expected a number"),
        ("residual_m: 0.0012", "residual_m: 1.2", r"metres\? 1.2 mm are 0.0012 m"),
        ("residual_m: 0.0012", "residual_m: .nan", r"residual_m: expected a number"),
        ("position: [0.7,", "position: [700,", r"pose_in_base.position\[0\]: .*metres\? 700 mm"),
        ("quaternion_xyzw: [", "quaternion_xyzw: [0.9, ", r"expected four numbers"),
        ("points: 7", "points: 7\n  points: 8", r"the key 'points' stands in line"),
    ],
)
def test_a_damaged_calibration_is_told_by_its_key(tmp_path, old, new, told):
    file = tmp_path / "camera.yaml"
    save_camera(file, LENS, CameraPose(POSE, 0.0012, 7))
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    with pytest.raises(UserError, match=told) as refused:
        load_camera(file)
    assert str(file) in str(refused.value)
    assert "calibrate" in str(refused.value)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("3: [1, 2]", "one line"),
        ("3: [300, 0, 20]", r"key 3: 300 is implausible.*metres\? 300 mm"),
        ("3: [.nan, 0, 0]", "key 3: nan is implausible"),
        ("true: [0, 0, 0]", "one line"),
        ("3: [0, 0, 0]\n3: [1, 0, 0]", "stands in line 1 and in line 2"),
        ("[" * 3000, "nested"),
    ],
)
def test_places_of_markers_that_cannot_be_are_told(tmp_path, text, told):
    file = tmp_path / "points.yaml"
    file.write_text(text)
    with pytest.raises(UserError, match=told):
        load_points(file)


def test_a_lens_alone_is_no_camera(tmp_path):
    save_camera(tmp_path / "camera.yaml", LENS)
    with pytest.raises(UserError, match="calibrate base"):
        load_camera(tmp_path / "camera.yaml")
