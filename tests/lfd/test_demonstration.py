import dataclasses
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.lfd import Action, Demonstration, DemonstrationFolder, Frames, Instance, Pose, learn
from bt_jax.lfd.demonstration import RecordedTask
from bt_jax.tasks import load_task
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations, one_demonstration

FRAMES = Frames.of(STACK3)
numbers = st.floats(-5, 5).map(lambda x: round(x, 5) + 0.0)


vectors = st.tuples(numbers, numbers, numbers)
turns = st.lists(st.tuples(vectors, vectors), min_size=len(FRAMES.names), max_size=len(FRAMES.names))


def pose(position, rotation):
    return Pose(
        position, tuple(round(float(x), 5) + 0.0 for x in Rotation.from_rotvec(rotation).as_quat(scalar_first=True))
    )


def demonstration(of_actions):
    """Picks and places in turn, with a position and a rotation vector for each frame."""
    return Demonstration(
        "",
        tuple(
            Action(
                kind,
                {frame: pose(*one) for frame, one in zip(FRAMES.names, given, strict=True)}
                | ({"BlueBox": Pose((0.01, 0.0, 0.12))} if kind == "pick" else {}),
            )
            for kind, given in zip(["pick", "place"] * 3, of_actions, strict=False)
        ),
    )


def test_files_have_quaternions_xyzw_and_poses_wxyz(tmp_path):
    turned = pose((0.1, 0.2, 0.3), (0.0, 0.0, 1.0))
    actions = tuple(Action(kind, dict.fromkeys(FRAMES.names, turned)) for kind in ("pick", "place"))
    made = DemonstrationFolder(tmp_path / "made")
    made.create(FRAMES)
    made.append(Demonstration("", actions))
    written = yaml.safe_load((made.path / "demo1" / "data_1.yaml").read_text())["vec_quat"]["BlueBox"]
    np.testing.assert_allclose(written, Rotation.from_rotvec((0.0, 0.0, 1.0)).as_quat(), atol=1e-5)
    assert made.read().demonstrations[0].actions[0].poses["BlueBox"] == turned


@pytest.fixture
def folder(tmp_path):
    made = DemonstrationFolder(tmp_path / "stacking")
    made.create(FRAMES)
    for one in demonstrations(STACK3, STACKING):
        made.append(one)
    return made


def files(folder):
    return {str(path.relative_to(folder.path)): path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}


@settings(max_examples=15)
@given(
    drawn=st.lists(
        st.lists(turns, min_size=2, max_size=6).filter(lambda one: len(one) % 2 == 0), min_size=1, max_size=3
    )
)
def test_what_is_written_is_read(tmp_path_factory, drawn):
    given = [demonstration(one) for one in drawn]
    folder = DemonstrationFolder(tmp_path_factory.mktemp("set"))
    folder.create(FRAMES)
    written = [folder.append(one) for one in given]
    read = folder.read()
    assert read.frames == FRAMES
    assert read.problems == ()
    assert list(read) == written
    assert [one.actions for one in read] == [one.actions for one in given]
    assert [one.name for one in read] == [f"demo{i}" for i in range(1, len(given) + 1)]


@given(position=vectors, rotation=vectors, point=vectors)
def test_a_pose_turns_as_scipy_does(position, rotation, point):
    expected = Rotation.from_rotvec(rotation).apply(point) + position
    np.testing.assert_allclose(pose(position, rotation).apply(point), expected, atol=5e-4)  # quaternions are rounded


def test_demonstrations_are_in_natural_order(folder):
    for _ in range(8):
        folder.append(one_demonstration(STACK3))
    assert folder.names() == [f"demo{i}" for i in range(1, 12)]


def test_append_never_takes_the_name_of_another(folder):
    folder.delete("demo2")
    before = files(folder)
    assert folder.append(one_demonstration(STACK3)).name == "demo4"
    assert before.items() <= files(folder).items()


def test_an_older_folder_keeps_its_task_whatever_is_recorded_into_it(tmp_path):
    """Folders written before name their task in info.yaml only."""
    folder = DemonstrationFolder(tmp_path / "shown")
    assert folder.task() is None
    folder.create(Frames.of(STACK3))
    assert folder.task() == STACK3
    (folder.path / "task.yaml").unlink()
    folder.create(Frames.of(dataclasses.replace(STACK3, name="mine")))
    assert not (folder.path / "task.yaml").exists()
    assert folder.task() == STACK3
    folder.create(Frames.of(STACK3))
    assert (folder.path / "task.yaml").exists()


def test_delete_takes_one_only(folder):
    before = files(folder)
    folder.delete("demo2")
    assert files(folder) == {name: data for name, data in before.items() if not name.startswith("demo2")}


@pytest.mark.parametrize("name", ["../stacking", "x/../../other", "demo9", ""])
def test_what_is_no_demonstration_is_not_deleted(folder, name):
    for other in (folder.path.parent / "other.deleted", folder.path / ".x", folder.path.parent / "other"):
        other.mkdir()
    before = sorted(folder.path.parent.rglob("*"))
    with pytest.raises(UserError, match="has no demonstration"):
        folder.delete(name)
    assert sorted(folder.path.parent.rglob("*")) == before


def test_rename_loses_nothing(folder):
    before = list(folder.read())
    folder.rename("demo1", "first try")
    assert sorted(one.name for one in folder.read()) == ["demo2", "demo3", "first try"]
    assert {one.name: one.actions for one in folder.read()}["first try"] == before[0].actions


@pytest.mark.parametrize("new", ["demo2", "../away", "", ".hidden", "a/b"])
def test_a_bad_name_changes_nothing(folder, new):
    before = files(folder)
    with pytest.raises(UserError, match=r"choose another name|use letters"):
        folder.rename("demo1", new)
    assert files(folder) == before


def test_what_is_not_there_is_reported(folder):
    for change in (folder.delete, lambda name: folder.rename(name, "new")):
        with pytest.raises(UserError, match="no demonstration 'demo9'; it has demo1, demo2, demo3"):
            change("demo9")


def test_other_frames_need_another_folder(folder):
    before = files(folder)
    folder.create(FRAMES)
    with pytest.raises(UserError, match="other frames; choose another folder"):
        folder.create(dataclasses.replace(FRAMES, default="KittingBox"))
    assert files(folder) == before


BAD_SEQUENCES = [
    (("place",), "a place follows no pick"),
    (("pick", "pick", "place"), "a pick follows a pick"),
    (("pick",), "ends with an object in the gripper"),
    ((), "no actions"),
]


@pytest.mark.parametrize(("actions", "message"), BAD_SEQUENCES)
def test_a_senseless_sequence_is_not_appended(folder, actions, message):
    before = files(folder)
    with pytest.raises(UserError, match=message):
        folder.append(one_demonstration(STACK3, actions=actions))
    assert files(folder) == before


BAD_POSES = [
    Pose((math.nan, 0.0, 0.0)),
    Pose((0.0, math.inf, 0.0)),
    Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0)),
    Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.nan, 1.0)),
]


@pytest.mark.parametrize("pose", BAD_POSES)
def test_a_senseless_pose_is_not_appended(folder, pose):
    before = files(folder)
    good = one_demonstration(STACK3)
    place = Action("place", {**good.actions[1].poses, "BlueBox": pose})
    with pytest.raises(UserError, match="action 2: the pose in BlueBox"):
        folder.append(Demonstration("", (good.actions[0], place)))
    with pytest.raises(UserError, match="one pose for each"):
        folder.append(Demonstration("", (good.actions[0], Action("place", {"BlueBox": Pose((0.0, 0.0, 0.0))}))))
    assert files(folder) == before


def edited(**changes):
    """Changes the second file of demo2; None deletes a key."""

    def change(folder):
        file = folder.path / "demo2" / "data_2.yaml"
        data = yaml.safe_load(file.read_text())
        for key, value in changes.items():
            if key == "type":
                data[key] = value
            else:
                data[key].update(value)
                data[key] = {frame: vector for frame, vector in data[key].items() if vector is not None}
        file.write_text(yaml.safe_dump(data))

    return change


def write(text):
    return lambda folder: (folder.path / "demo2" / "data_2.yaml").write_text(text)


def in_millimetres(demonstration, folder):
    for file in (folder.path / demonstration).iterdir():
        data = yaml.safe_load(file.read_text())
        data["vec_pos"] = {frame: [1000 * x for x in vector] for frame, vector in data["vec_pos"].items()}
        file.write_text(yaml.safe_dump(data))


def emptied(folder):
    shutil.rmtree(folder.path / "demo2")
    (folder.path / "demo2").mkdir()


BAD = {
    "empty folder": (emptied, r"^demo2 is left out: .*data_1.yaml is missing; restore it, or delete .*demo2\.$"),
    "millimetres": (
        lambda f: in_millimetres("demo2", f),
        r"at every pick the gripper was [\d.]+ m or more from every object; correct the positions "
        r"\(metres\? these look like millimetres\), or delete",
    ),
    "one far position": (
        edited(vec_pos={"base_link": [0, 120, 0]}),
        r"data_2.yaml, key vec_pos.base_link: 120 is implausible; write -10 to 10 m \(metres\? 120 mm are 0.12 m\)",
    ),
    "another version": (
        lambda f: (f.path / "demo2" / "data_2_new.yaml").write_text("type: pick"),
        r"data_2_new.yaml is none of its actions, which are called data_1.yaml, .*; move it out of the folder\.$",
    ),
    "two of a number": (
        lambda f: (f.path / "demo2" / "data_2.yml").write_text("type: pick"),
        r"data_2.yml is none of its actions, .*; move it out of the folder\.$",
    ),
    "another ending": (
        lambda f: (f.path / "demo2" / "data_2.yaml").rename(f.path / "demo2" / "data_2.yml"),
        r"data_2.yml is called .yml; rename it to data_2.yaml\.$",
    ),
    "deep": (write("type: " + "[" * 3000), r"data_2.yaml, line 1: brackets are nested more than 30 deep; check them"),
    "hole": (lambda f: (f.path / "demo2" / "data_3.yaml").unlink(), r"data_3.yaml is missing; restore it"),
    "end missing": (lambda f: (f.path / "demo2" / "data_6.yaml").unlink(), r"object in the gripper; place it"),
    "two picks": (edited(type="pick"), r"action 2: a pick follows a pick without a place; record it again"),
    "type": (edited(type="push"), r"data_2.yaml, key type: expected one of pick, place, found 'push'"),
    "no type": (edited(type=None), r"data_2.yaml, key type: expected one of pick, place, found null"),
    "unknown frame": (
        edited(vec_pos={"PinkBox": [0, 0, 0]}),
        r"data_2.yaml, key vec_pos.PinkBox: info.yaml has no frame of this name; add it there",
    ),
    "frame missing": (edited(vec_quat={"BlueBox": None}), r"data_2.yaml, key vec_quat.BlueBox: missing; record"),
    "nan": (
        edited(vec_pos={"BlueBox": [math.nan, 0, 0]}),
        r"key vec_pos.BlueBox\[0\]: expected a number, found nan",
    ),
    "infinite": (
        edited(vec_pos={"BlueBox": [0, -math.inf, 0]}),
        r"key vec_pos.BlueBox\[1\]: expected a number, found -inf",
    ),
    "too large": (
        edited(vec_pos={"BlueBox": [0, 10**400, 0]}),
        r"key vec_pos.BlueBox\[1\]: expected a number, found 1000",
    ),
    "truth": (edited(vec_pos={"BlueBox": [0, True, 0]}), r"key vec_pos.BlueBox\[1\]: expected a number, found true"),
    "two numbers": (
        edited(vec_pos={"BlueBox": [0, 0]}),
        r"key vec_pos.BlueBox: expected three numbers, found \[0, 0\]",
    ),
    "no numbers": (edited(vec_quat={"BlueBox": "up"}), r"key vec_quat.BlueBox: expected four numbers, found 'up'"),
    "not unit": (
        edited(vec_quat={"BlueBox": [0, 0, 1, 1]}),
        r"key vec_quat.BlueBox: has length 1.41, not 1; record it again",
    ),
    "half written": (write(""), r"data_2.yaml: expected a mapping, found null; write keys such as type, vec_pos"),
    "list": (write("- 1"), r"data_2.yaml: expected a mapping, found \[1\]"),
    "no YAML": (write("type: [pick"), r"data_2.yaml, line 1 is not valid YAML .*, or delete .*demo2\.$"),
    "no date": (write("type: 2020-99-99"), r"key vec_pos: missing; add it, for instance vec_pos: {base_link"),
    "no positions": (write("type: place"), r"data_2.yaml, key vec_pos: missing; add it"),
}


@pytest.mark.parametrize("kind", BAD)
def test_a_bad_demonstration_is_left_out_with_a_sentence(folder, kind):
    damage, sentence = BAD[kind]
    good = list(folder.read())
    damage(folder)
    before = files(folder)
    read = folder.read()
    assert list(read) == [good[0], good[2]]
    (problem,) = read.problems
    assert str(folder.path / "demo2") in problem
    assert problem.endswith(".")
    assert "\n" not in problem
    assert re.search(sentence, problem)
    folder.append(one_demonstration(STACK3))
    assert before.items() <= files(folder).items()


@pytest.mark.parametrize("kind", ["half written", "nan", "not unit"])
def test_where_nothing_is_usable_the_sentence_is_the_error(folder, kind):
    damage, sentence = BAD[kind]
    folder.delete("demo1")
    folder.delete("demo3")
    damage(folder)
    with pytest.raises(UserError, match=sentence):
        folder.read()


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
    left = files(folder)
    with pytest.raises(UserError, match="other frames; choose another folder"):
        folder.create(dataclasses.replace(FRAMES, names=(*FRAMES.names, "PinkBox")))
    assert files(folder) == left
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


def test_where_several_are_unusable_one_sentence_says_why(folder):
    for name in ("demo1", "demo2", "demo3"):
        in_millimetres(name, folder)
    with pytest.raises(
        UserError, match=r"^none of 3 demonstrations can be used: demo1 is left out: at every pick"
    ) as error:
        folder.read()
    assert "demo2" not in str(error.value)


def test_a_missing_or_empty_folder_is_named(tmp_path):
    folder = DemonstrationFolder(tmp_path / "none")
    with pytest.raises(UserError, match=r"there is no folder .*none; give one"):
        folder.read()
    folder.path.mkdir()
    with pytest.raises(UserError, match=r"info\.yaml is missing or empty; restore it"):
        folder.read()
    folder.create(Frames(("KittingBox", "base_link"), "base_link", "base_link"))
    with pytest.raises(UserError, match="none holds no demonstration; record some"):
        folder.read()


def test_a_new_name_keeps_the_place_in_the_order(folder):
    shown = [one.actions for one in folder.read()]
    folder.rename("demo1", "z last")
    folder.rename("demo3", "a first")
    assert folder.names() == ["z last", "demo2", "a first"]
    assert [one.actions for one in folder.read()] == shown
    folder.delete("demo2")
    assert folder.append(one_demonstration(STACK3)).name == "demo1"
    assert folder.names() == ["z last", "a first", "demo1"]


@pytest.mark.parametrize("change", [lambda f: f.rename("demo2", "better"), lambda f: f.delete("demo2")])
@pytest.mark.parametrize("step", range(4))
def test_a_change_that_is_cut_off_loses_nothing(folder, monkeypatch, change, step):
    """Whatever the process had come to when it was killed: every demonstration is whole, there or gone."""
    before = {one.name: one.actions for one in folder.read()}
    folder.choose(folder.read(), [Instance(1, 1)], "KittingBox")
    left = iter(range(step))

    def counted(function):
        def call(*arguments, **options):
            if next(left, None) is None:
                raise KeyboardInterrupt
            return function(*arguments, **options)

        return call

    with monkeypatch.context() as patch:
        patch.setattr("bt_jax.lfd.demonstration_folder.write_atomic", counted(write_atomic))
        patch.setattr("pathlib.Path.rename", counted(Path.rename))
        patch.setattr("shutil.rmtree", counted(shutil.rmtree))
        try:
            change(folder)
        except KeyboardInterrupt:
            assert step < 4
    after = folder.read()
    actions = [one.actions for one in after]
    assert actions in ([*before.values()], [before["demo1"], before["demo3"]])
    assert {"demo1", "demo3"} <= {one.name for one in after}
    if len(actions) == 3:
        assert after.chosen == {Instance(1, 1): "KittingBox"}


def test_chosen_frames_follow_their_demonstration(folder):
    read = folder.read()
    folder.choose(read, [Instance(0, 1), Instance(2, 3)], "KittingBox")
    folder.choose(read, [Instance(1, 1)], "base_link")
    assert folder.read().chosen == {
        Instance(0, 1): "KittingBox", Instance(2, 3): "KittingBox", Instance(1, 1): "base_link"
    }  # fmt: skip
    folder.rename("demo1", "one")
    folder.delete("demo2")
    assert folder.read().chosen == {Instance(0, 1): "KittingBox", Instance(1, 3): "KittingBox"}
    folder.choose(folder.read(), [Instance(0, 1), Instance(1, 3)], None)
    assert folder.read().chosen == {}
    with pytest.raises(UserError, match="no frame 'PinkBox'; use one of"):
        folder.choose(folder.read(), [Instance(0, 1)], "PinkBox")
    with pytest.raises(UserError, match="no demonstration 'demo2'"):
        folder.choose(read, [Instance(1, 1)], "base_link")


def test_it_is_known_in_which_task_was_recorded(folder, tmp_path):
    assert folder.frames().recorded == RecordedTask("stack3", {"YellowBox": 0.1, "GreenBox": 0.1, "BlueBox": 0.1})
    yumi = load_task("yumi_stack")
    with pytest.raises(UserError, match="boxes of other sizes; choose another folder"):
        folder.create(Frames.of(yumi))
    folder.create(Frames.of(load_task("stack")))  # has the same boxes
    with pytest.raises(
        UserError, match=r"YellowBox measures 0\.1 m in task stack3 and 0\.04 m in yumi_stack; choose task"
    ):
        learn(folder.read(), yumi)
    published = DemonstrationFolder(tmp_path / "published")
    published.create(dataclasses.replace(FRAMES, recorded=None))
    assert "task" not in (published.path / "info.yaml").read_text()
    published.append(demonstrations(STACK3, STACKING).demonstrations[0])
    assert published.frames().recorded is None
    learn(published.read(), yumi)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"task": 3}, "key task: expected text, found 3; put it in quotes: '3', or remove the keys task and boxes"),
        ({"boxes": [0.1]}, "key boxes: expected a mapping"),
        ({"boxes": {"YellowBox": "large"}}, "key boxes.YellowBox: expected a number, found 'large'"),
        ({"task": None}, "key task: expected text, found null"),
        ({"boxes": {"YellowBox": 100}}, r"key boxes.YellowBox: 100 is implausible; .*metres\? 100 mm are 0.1 m"),
    ],
)
def test_a_damaged_scene_is_named(folder, bad, message):
    source = folder.path / "info.yaml"
    source.write_text(yaml.safe_dump({**yaml.safe_load(source.read_text()), **bad}))
    with pytest.raises(UserError, match=rf"info\.yaml, {message}"):
        folder.read()


def test_the_inverse_of_a_pose_undoes_it():
    pose = Pose((0.3, -0.2, 0.7), (0.5, 0.5, -0.5, 0.5))
    np.testing.assert_allclose(pose.inverse().apply(pose.apply((1.0, 2.0, 3.0)).tolist()), (1, 2, 3), atol=1e-12)
