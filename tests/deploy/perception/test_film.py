"""A folder of pictures as a camera, and when each picture was taken."""

import numpy as np
import pytest
from PIL import Image

from bt_jax._util.errors import UserError
from bt_jax.deploy.perception.calibration import Intrinsics
from bt_jax.deploy.perception.camera import Camera, CameraFrame
from bt_jax.deploy.perception.film import FilmCamera, FilmEnded, Recorder, pictures_in, read_picture
from bt_jax.deploy.perception.opening import open_camera

LENS = Intrinsics(np.array([[20.0, 0, 11.5], [0, 20, 8.5], [0, 0, 1]]), np.zeros(5), 24, 18, 0.1)


class Pictures:
    """A camera that gives images of its own, or none."""

    def __init__(self, count: int) -> None:
        rng = np.random.default_rng(0)
        self.images = [rng.integers(0, 256, (48, 64, 3), np.uint8) for _ in range(count)]
        self.index = 0

    def read(self) -> CameraFrame:
        image = self.images[min(self.index, len(self.images) - 1)]
        self.index += 1
        return CameraFrame(image, 10.0 + 0.1 * min(self.index, len(self.images)), np.eye(3), np.arange(5.0))

    def close(self) -> None:
        self.images = []


def filmed(folder, *names, size=(24, 18), taken=()):
    folder.mkdir(exist_ok=True)
    for i, name in enumerate(names):
        exif = Image.Exif()
        if taken:
            exif.get_ifd(0x8769).update(taken[i])
        Image.new("RGB", size, (10 * i, 0, 200)).save(folder / name, exif=exif)
    return folder


def times(folder, fps=None):
    camera, found = FilmCamera(folder, LENS, fps), []
    while True:
        try:
            found.append(camera.read().time)
        except FilmEnded:
            return found


NAMED = {
    ("a_12.5.png", "a_9.25.png"): [9.25, 12.5],
    ("0.000.jpg", "0.100.jpg", "0.200.jpg"): [0.0, 0.1, 0.2],
    ("1718000000123.png", "1718000000223.png"): [1718000000.123, 1718000000.223],
    ("cam-1718000000123456789.png", "cam-1718000000223456789.png"): [1718000000.1234567, 1718000000.2234567],
}


@pytest.mark.parametrize("names", NAMED, ids=" ".join)
def test_names_tell_times(tmp_path, names):
    assert times(filmed(tmp_path / "film", *names)) == pytest.approx(NAMED[names], rel=1e-12)


def test_the_camera_may_have_written_them(tmp_path):
    taken = [{36867: f"2026:03:01 10:00:0{second}", 37521: part} for second, part in ((1, "50"), (2, "025"))]
    first, second = times(filmed(tmp_path / "film", "IMG_1.jpg", "IMG_2.jpg", taken=taken))
    assert second - first == pytest.approx(0.525)


def test_a_rate_counts_more_than_what_pictures_tell(tmp_path):
    folder = filmed(tmp_path / "film", "frame9.png", "frame10.png", "frame11.png")
    assert times(folder, fps=4.0) == [0, 0.25, 0.5]
    camera = FilmCamera(folder, LENS, 4.0)
    assert [int(camera.read().image[0, 0, 0]) for _ in range(3)] == [0, 10, 20]  # frame9 before frame10


def test_what_was_recorded_is_played_back(tmp_path):
    pictures = Pictures(3)
    recorder = Recorder(pictures, tmp_path)
    assert isinstance(recorder, Camera)
    for _ in range(5):
        recorder.read()
    played = FilmCamera(tmp_path, LENS)
    for i, image in enumerate(pictures.images):
        frame = played.read()
        np.testing.assert_array_equal(frame.image, image)
        np.testing.assert_array_equal(frame.distortion, np.arange(5.0))
        assert frame.time == pytest.approx(10.1 + 0.1 * i)
    with pytest.raises(FilmEnded, match="end"):
        played.read()


def test_a_recording_plays_by_the_clock(tmp_path):
    pictures, now = Pictures(3), [50.0]
    recorder = Recorder(pictures, tmp_path)
    for _ in range(3):
        recorder.read()
    played = FilmCamera(tmp_path, LENS, clock=lambda: now[0])
    for passed, index in [(0.0, 0), (0.09, 0), (0.11, 1), (5.0, 2)]:
        now[0] = 50.0 + passed
        frame = played.read()
        np.testing.assert_array_equal(frame.image, pictures.images[index])
        assert frame.time == pytest.approx(50.0 + 0.1 * index)


def test_bad_recordings_are_refused(tmp_path):
    with pytest.raises(UserError, match="holds no pictures"):
        FilmCamera(tmp_path, LENS)
    filmed(tmp_path, "000000.png")
    (tmp_path / "000000.json").write_text("{}")
    with pytest.raises(UserError, match="record again"):
        FilmCamera(tmp_path, LENS)


def test_a_recording_at_another_rate_keeps_its_lens(tmp_path):
    recorder = Recorder(Pictures(2), tmp_path)
    for _ in range(2):
        recorder.read()
    assert times(tmp_path) == pytest.approx([10.1, 10.2])
    assert times(tmp_path, fps=2.0) == [0, 0.5]
    frame = FilmCamera(tmp_path, LENS, 2.0).read()
    np.testing.assert_array_equal(frame.distortion, np.arange(5.0))
    np.testing.assert_array_equal(frame.matrix, np.eye(3))


def test_every_folder_of_pictures_that_is_watched_is_also_played(tmp_path):
    folder = filmed(tmp_path / "film", "a_12.5.webp", "a_9.25.webp")
    assert [path.name for path in pictures_in(folder)] == ["a_9.25.webp", "a_12.5.webp"]
    played = open_camera(str(folder), LENS, clock=lambda: 100.0).read()
    assert played.time == 100.0
    np.testing.assert_array_equal(played.matrix, LENS.matrix)
    watched = open_camera(str(folder), LENS, realtime=False)
    assert [watched.read().time, watched.read().time] == [9.25, 12.5]


def test_a_picture_is_not_turned_as_its_camera_was_held(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation: to be turned by 90 degrees
    Image.new("RGB", (24, 18)).save(tmp_path / "board.jpg", exif=exif)
    assert read_picture(tmp_path / "board.jpg").shape == (18, 24, 3)


BAD = {
    "no times": (("frame1.png", "frame2.png"), (24, 18), "do not tell when they were taken.*--fps"),
    "twice the same": (("0.5.png", "a0.5.png"), (24, 18), "do not tell when they were taken"),
    "none": ((), (24, 18), "holds no pictures; give a folder"),
    "another size": (("0.5.png",), (48, 36), "is 48 x 36 and the lens was calibrated at 24 x 18"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_wrong_with_a_film_is_said(tmp_path, name):
    names, size, message = BAD[name]
    folder = filmed(tmp_path / "film", *names, size=size)
    with pytest.raises(UserError, match=message):
        times(folder)


def test_a_damaged_picture_is_named(tmp_path):
    folder = filmed(tmp_path / "film", "0.5.png", "0.6.png")
    (folder / "0.6.png").write_bytes(b"no picture")
    with pytest.raises(UserError, match=r"0\.6\.png cannot be read as a picture"):
        times(folder)
