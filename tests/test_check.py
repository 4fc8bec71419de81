import json
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from bt_jax.check import main
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import DemonstrationFolder, Frames
from bt_jax.tasks import load_task
from bt_jax.teaching.kit_file import KitFile
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import RunNote, write_note
from bt_jax.training.settings import Settings
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

TREE = "Sequence(pick(YellowBox), place(YellowBox, (0, 0, 0.055), KittingBox))"
MATRIX = [[600, 0, 320], [0, 600, 240], [0, 0, 1]]
LENS = {"width": 640, "height": 480, "matrix": MATRIX, "distortion": [0] * 5, "error_px": 0.3}


def demos(path):
    folder = DemonstrationFolder(path)
    folder.create(Frames.of(STACK3))
    for one in demonstrations(STACK3, STACKING):
        folder.append(one)


def trained(path):
    RunFolder.create(path, RunConfig(load_task("stack"), GPConfig(), Settings())).save_tree(parse_tree(TREE), title="x")


def learnt(path):
    path.mkdir()
    (path / "learnt_tree.txt").write_text(TREE)
    (path / "task.yaml").write_text("extends: stack\nname: mine\n")


def named(path):
    trained(path)
    write_note(path, RunNote("the one for Monday", "slow"))


def text(content):
    return lambda path: path.write_text(content)


FINE = {
    "task.yaml": (text("extends: stack\nname: mine\n"), "task mine, 3 objects, 2 targets"),
    "tree.txt": (text(TREE), "tree, 3 nodes"),
    "script.txt": (
        text("# first\npick BlueBox; to (0, 0, 0.1) GreenBox; release"),
        "script of a demonstration, 3 steps",
    ),
    "tree.xml": (text(to_xml(parse_tree(TREE))), "tree in XML, 3 nodes"),
    "demos": (demos, "folder of demonstrations, 3 demonstrations, 18 actions"),
    "run": (trained, "run folder, task stack, not begun, 3 nodes"),
    "named": (named, 'run folder "the one for Monday", task stack, not begun, 3 nodes'),
    "line.kit.zip": (
        lambda path: path.write_bytes(KitFile(load_task("stack"), trees={"mine": parse_tree(TREE)}).pack()),
        "kit, task stack, 0 sets of demonstrations, 1 tree",
    ),
    "learnt": (learnt, "folder of a learnt tree, task mine, 3 nodes"),
}


def check(capsys, *paths):
    """Exit code, lines of stdout, lines of stderr."""
    with pytest.raises(SystemExit) as end:
        main(list(map(str, paths)))
    shown = capsys.readouterr()
    return end.value.code, shown.out.splitlines(), shown.err.splitlines()


@pytest.mark.parametrize("name", FINE)
def test_what_is_fine_is_named_with_its_kind_and_a_summary(tmp_path, capsys, name):
    make, summary = FINE[name]
    make(tmp_path / name)
    before = sorted(tmp_path.rglob("*"))
    assert check(capsys, tmp_path / name) == (0, [f"fine {tmp_path / name}: {summary}"], [])
    assert sorted(tmp_path.rglob("*")) == before


def test_files_inside_are_checked_as_what_they_belong_to(tmp_path, capsys):
    demos(tmp_path / "demos")
    trained(tmp_path / "run")
    inner = ("demos/info.yaml", "demos/demo1/data_1.yaml", "run/config.json")
    code, fine, wrong = check(capsys, *(tmp_path / name for name in inner))
    assert (code, wrong) == (0, [])
    assert [line.split(": ", 1)[1] for line in fine] == [
        "folder of demonstrations, 3 demonstrations, 18 actions",
        "action of demonstration demo1, 6 actions",
        "configuration of a run, task stack, population 16",
    ]


def test_calibration_files(tmp_path, capsys):
    pytest.importorskip("cv2")
    lens, points, bad = tmp_path / "camera.yaml", tmp_path / "markers.yaml", tmp_path / "bad.yaml"
    lens.write_text(yaml.safe_dump({"intrinsics": LENS}))
    points.write_text("3: [0.3, 0.1, 0]\n4: [0.3, -0.1, 0]\n")
    bad.write_text("3: [300, 100, 0]\n")
    code, fine, wrong = check(capsys, lens, points, bad)
    assert code == 2
    assert fine[0] == f"fine {lens}: calibration file, 640 x 480 px, error 0.3 px, lens only"
    assert fine[1] == f"fine {points}: places of markers, 2 markers"
    assert len(wrong) == 1
    assert "300 is implausible" in wrong[0]


def damaged_run(path):
    trained(path)
    (path / "checkpoint.npz").write_bytes(b"PK")


def other_tree(path):
    trained(path)
    (path / "best_tree.txt").write_text(TREE.replace("YellowBox", "PinkBox"))


def unknown_format(path):
    trained(path)
    config = json.loads((path / "config.json").read_text())
    (path / "config.json").write_text(json.dumps(config | {"format": 99}))


def deep_demonstration(path):
    demos(path)
    for name in ("demo1", "demo2"):
        (path / name / "data_1.yaml").write_text("[" * 3000)


WRONG = {
    "x" * 300: (lambda path: None, "File name too long"),
    "long.yaml": (text(f"extends: {'x' * 3000}\n"), "is not another task"),
    "lines.yaml": (text('extends: stack\nname: "a\\nb"\n'), "key name: 'a b' is not a name"),
    "gone.yaml": (lambda path: None, "there is no file or folder"),
    "photo.png": (text("x"), "photo.png is nothing that can be checked; give a task (.yaml)"),
    "empty": (Path.mkdir, "empty is nothing that can be checked; give a task (.yaml)"),
    "task.yaml": (text("extends: stack\nname: mine\nboxes: 3\n"), "task.yaml, key boxes: expected a list, found 3"),
    "goal.yaml": (
        text("extends: stack\nname: x\nsubgoals: [{name: a, conditions: ['clear(YellowBox)', 'clear(PinkBox)']}]\n"),
        "goal.yaml, key subgoals[0].conditions[1]: clear(PinkBox): task x has no object 'PinkBox'",
    ),
    "tree.txt": (text("Sequence(pick(YellowBox)"), "tree.txt, line 1"),
    "tree.xml": (text("<root"), "tree.xml"),
    "run": (damaged_run, "checkpoint.npz is damaged"),
    "other": (other_tree, "best_tree.txt: pick(PinkBox): task stack has no object 'PinkBox'"),
    "future": (unknown_format, "format 99"),
    "demos": (deep_demonstration, "demo1 is left out: "),
    "mine.npz": (
        lambda path: np.savez(path, a=np.zeros(3)),
        "mine.npz is no checkpoint of train; give one that train has",
    ),
    "bad.npz": (text("PK"), "bad.npz is damaged; give one that train has written"),
    "pipe.npz": (getattr(os, "mkfifo", text("PK")), "pipe.npz is"),
    "pipe.yaml": (getattr(os, "mkfifo", text("[")), "pipe.yaml"),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_one_sentence(tmp_path, capsys, name):
    make, words = WRONG[name]
    make(tmp_path / name)
    code, fine, wrong = check(capsys, tmp_path / name)
    assert (code, fine, len(wrong)) == (2, [], 1)
    assert wrong[0].startswith("error: ")
    assert words in wrong[0]
    assert len(wrong[0]) < 800


def test_one_bad_file_hides_no_other(tmp_path, capsys):
    for name in ("task.yaml", "tree.txt", "tree.xml", "demos", "run"):
        FINE[name][0](tmp_path / name)
    (tmp_path / "bad.yaml").write_text("a: [")
    (tmp_path / "notes.md").write_text("not ours")
    (tmp_path / ".hidden.yaml").write_text("a: [")
    code, fine, wrong = check(capsys, tmp_path)
    assert (code, len(fine), len(wrong)) == (2, 5, 1)
    assert str(tmp_path / "bad.yaml") in wrong[0]
    code, fine, wrong = check(capsys, tmp_path / "bad.yaml", tmp_path / "tree.txt")
    assert (code, len(fine), len(wrong)) == (2, 1, 1)


def test_links_between_folders_are_followed_once(tmp_path, capsys):
    folder = tmp_path / "trees"
    folder.mkdir()
    FINE["tree.txt"][0](folder / "tree.txt")
    for name in ("again", "and_again"):
        (folder / name).symlink_to(".")
    (tmp_path / "link").symlink_to("trees")
    for given in (folder, tmp_path, tmp_path / "link"):
        code, fine, wrong = check(capsys, given)
        assert (code, len(fine), wrong) == (0, 1, [])


def test_demonstrations_without_information_are_fine_and_say_so(tmp_path, capsys):
    demos(tmp_path / "demos")
    (tmp_path / "demos" / "info.yaml").write_text("")
    code, fine, wrong = check(capsys, tmp_path / "demos")
    assert (code, wrong) == (0, [])
    assert fine[0].endswith("18 actions; info.yaml is missing or empty, the frames are taken from the demonstrations")


def test_without_a_file_it_says_what_to_give(capsys):
    with pytest.raises(SystemExit) as end:
        main([])
    assert end.value.code == 2
