import math
import re
import shutil

import pytest
import yaml

from bt_jax._util.errors import UserError
from bt_jax.lfd import Action, Demonstration, Pose
from tests.helpers.demonstrations import STACK3, files_of, in_millimetres, one_demonstration

BAD_SEQUENCES = [
    (("place",), "a place follows no pick"),
    (("pick", "pick", "place"), "a pick follows a pick"),
    (("pick",), "ends with an object in the gripper"),
    ((), "no actions"),
]


@pytest.mark.parametrize(("actions", "message"), BAD_SEQUENCES)
def test_a_senseless_sequence_is_not_appended(folder, actions, message):
    before = files_of(folder)
    with pytest.raises(UserError, match=message):
        folder.append(one_demonstration(STACK3, actions=actions))
    assert files_of(folder) == before


BAD_POSES = [
    Pose((math.nan, 0.0, 0.0)),
    Pose((0.0, math.inf, 0.0)),
    Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 2.0)),
    Pose((0.0, 0.0, 0.0), (0.0, 0.0, math.nan, 1.0)),
]


@pytest.mark.parametrize("pose", BAD_POSES)
def test_a_senseless_pose_is_not_appended(folder, pose):
    before = files_of(folder)
    good = one_demonstration(STACK3)
    place = Action("place", {**good.actions[1].poses, "BlueBox": pose})
    with pytest.raises(UserError, match="action 2: the pose in BlueBox"):
        folder.append(Demonstration("", (good.actions[0], place)))
    with pytest.raises(UserError, match="one pose for each"):
        folder.append(Demonstration("", (good.actions[0], Action("place", {"BlueBox": Pose((0.0, 0.0, 0.0))}))))
    assert files_of(folder) == before


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
        r"data_2_new.yaml is not one of its actions, which are called data_1.yaml, .*; move it out of the folder\.$",
    ),
    "two of a number": (
        lambda f: (f.path / "demo2" / "data_2.yml").write_text("type: pick"),
        r"data_2.yml is not one of its actions, .*; move it out of the folder\.$",
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
    before = files_of(folder)
    read = folder.read()
    assert list(read) == [good[0], good[2]]
    (problem,) = read.problems
    assert str(folder.path / "demo2") in problem
    assert problem.endswith(".")
    assert "\n" not in problem
    assert re.search(sentence, problem)
    folder.append(one_demonstration(STACK3))
    assert before.items() <= files_of(folder).items()


@pytest.mark.parametrize("kind", ["half written", "nan", "not unit"])
def test_where_nothing_is_usable_the_sentence_is_the_error(folder, kind):
    damage, sentence = BAD[kind]
    folder.delete("demo1")
    folder.delete("demo3")
    damage(folder)
    with pytest.raises(UserError, match=sentence):
        folder.read()


def test_where_several_are_unusable_one_sentence_says_why(folder):
    for name in ("demo1", "demo2", "demo3"):
        in_millimetres(name, folder)
    with pytest.raises(
        UserError, match=r"^none of 3 demonstrations can be used: demo1 is left out: at every pick"
    ) as error:
        folder.read()
    assert "demo2" not in str(error.value)
