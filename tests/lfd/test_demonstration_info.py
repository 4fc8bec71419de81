import dataclasses
from pathlib import Path

import pytest
import yaml

from bt_jax._util.errors import UserError
from bt_jax.lfd import Action, Demonstration, DemonstrationFolder, Frames, Pose
from tests.helpers.demonstrations import (
    FRAMES,
    STACK3,
    files_of,
    one_demonstration,
)

GOOD_INFO = {"frames": ["KittingBox", "base_link"], "default_frame": "base_link", "robot": "base_link"}


BAD_INFO = {
    "frames: [": "line 1 is not valid YAML",
    "": "info.yaml is missing or empty; restore it",
    "- 1": r"expected a mapping, found \[1\]; delete the file: the frames are taken from the demonstrations then",
    yaml.safe_dump({**GOOD_INFO, "frames": 3}): "key frames: expected a list of names, found 3",
    yaml.safe_dump({**GOOD_INFO, "frames": ["base_link"]}): "key frames: there must be at least two",
    yaml.safe_dump({**GOOD_INFO, "frames": ["base_link"] * 2}): "each once",
    yaml.safe_dump({**GOOD_INFO, "robot": "YuMi"}): "key robot: 'YuMi' is not one of the frames; use one of KittingBox",
    yaml.safe_dump(
        {k: v for k, v in GOOD_INFO.items() if k != "robot"}
    ): "key robot: missing; add it, for instance robot: b",
    yaml.safe_dump({**GOOD_INFO, "default_frame": None}): "key default_frame: expected text, found null",
}


@pytest.mark.parametrize("text", BAD_INFO)
def test_bad_information_is_named(tmp_path, text):
    (tmp_path / "info.yaml").write_text(text)
    with pytest.raises(UserError, match=BAD_INFO[text]) as error:
        DemonstrationFolder(tmp_path).read()
    assert str(tmp_path / "info.yaml") in str(error.value)
    assert (tmp_path / "info.yaml").read_text() == text


@pytest.mark.parametrize("kept", [True, False], ids=["task.yaml", "no task.yaml"])
@pytest.mark.parametrize("lost", [lambda path: path.write_text(""), Path.unlink], ids=["empty", "missing"])
def test_lost_information_is_taken_from_the_demonstrations(folder, lost, kept):
    before = folder.read()
    if not kept:
        (folder.path / "task.yaml").unlink()
    lost(folder.path / "info.yaml")
    (folder.path / "demo1" / "data_1.yaml").write_text("[" * 3000)
    read = folder.read()
    assert list(read) == list(before)[1:]
    assert set(read.frames.names) == set(FRAMES.names)
    assert (read.frames.default, read.frames.robot) == ("base_link", "base_link")
    if kept:
        assert read.frames == FRAMES
    assert "info.yaml is missing or empty: the frames are taken from the demonstrations." in read.problems[0]
    folder.append(one_demonstration(STACK3))
    folder.rename("demo2", "better")
    assert [one.name for one in folder.read()] == ["better", "demo3", "demo4"]


@pytest.mark.parametrize("lost", [lambda path: path.write_text(""), Path.unlink], ids=["empty", "missing"])
def test_with_lost_information_other_frames_still_need_another_folder(folder, lost):
    before = list(folder.read())
    lost(folder.path / "info.yaml")
    left = files_of(folder)
    with pytest.raises(UserError, match="other frames; choose another folder"):
        folder.create(dataclasses.replace(FRAMES, names=(*FRAMES.names, "PinkBox")))
    assert files_of(folder) == left
    folder.create(FRAMES)
    assert folder.frames() == FRAMES
    assert list(folder.read()) == before
    assert folder.read().problems == ()


def test_demonstrations_are_listed_whatever_the_information_has_come_to(folder):
    (folder.path / "info.yaml").write_text("frames: [")
    assert folder.names() == ["demo1", "demo2", "demo3"]


def test_a_robot_of_another_name_must_be_named(tmp_path):
    frames = Frames(("KittingBox", "BlueBox", "arm"), "arm", "arm")
    folder = DemonstrationFolder(tmp_path / "set")
    folder.create(frames)
    poses = dict.fromkeys(frames.names, Pose((0.0, 0.0, 0.12)))
    folder.append(Demonstration("", (Action("pick", poses), Action("place", poses))))
    (folder.path / "info.yaml").unlink()
    with pytest.raises(
        UserError, match=r"missing or empty; write the lines 'frames: \[KittingBox, BlueBox, arm\]', 'defa"
    ):
        folder.read()


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"task": 3}, "key task: expected text, found 3; put it in quotes: '3', or remove the keys task and boxes"),
        ({"boxes": [0.1]}, "key boxes: expected a mapping"),
        ({"boxes": {"YellowBox": "large"}}, "key boxes.YellowBox: expected a number or a list, found 'large'"),
        (
            {"boxes": {"YellowBox": [0.1] * 4}},
            "key boxes.YellowBox: a size does not have 4 numbers; write one for a cube",
        ),
        ({"boxes": {"YellowBox": [0.1, 0.1, 100]}}, r"key boxes.YellowBox: 100 is implausible; .*metres\?"),
        ({"task": None}, "key task: expected text, found null"),
        ({"boxes": {"YellowBox": 100}}, r"key boxes.YellowBox: 100 is implausible; .*metres\? 100 mm are 0.1 m"),
    ],
)
def test_a_damaged_scene_is_named(folder, bad, message):
    source = folder.path / "info.yaml"
    source.write_text(yaml.safe_dump({**yaml.safe_load(source.read_text()), **bad}))
    with pytest.raises(UserError, match=rf"info\.yaml, {message}"):
        folder.read()
