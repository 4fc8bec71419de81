import dataclasses
import shutil
from pathlib import Path

import pytest
import yaml

from bt_jax._util.errors import UserError
from bt_jax._util.files import write_atomic
from bt_jax.lfd import Corrections, DemonstrationFolder, Frames, Instance, learn
from bt_jax.lfd.demonstration import RecordedTask
from bt_jax.tasks import load_task
from tests.helpers.demonstrations import (
    FRAMES,
    STACK3,
    STACKING,
    demonstrations,
    files_of,
    one_demonstration,
)


def test_demonstrations_are_in_natural_order(folder):
    for _ in range(8):
        folder.append(one_demonstration(STACK3))
    assert folder.names() == [f"demo{i}" for i in range(1, 12)]


def test_append_never_takes_the_name_of_another(folder):
    folder.delete("demo2")
    before = files_of(folder)
    assert folder.append(one_demonstration(STACK3)).name == "demo4"
    assert before.items() <= files_of(folder).items()


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
    before = files_of(folder)
    folder.delete("demo2")
    assert files_of(folder) == {name: data for name, data in before.items() if not name.startswith("demo2")}


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
    before = files_of(folder)
    with pytest.raises(UserError, match=r"choose another name|use letters"):
        folder.rename("demo1", new)
    assert files_of(folder) == before


def test_what_is_not_there_is_reported(folder):
    for change in (folder.delete, lambda name: folder.rename(name, "new")):
        with pytest.raises(UserError, match="no demonstration 'demo9'; it has demo1, demo2, demo3"):
            change("demo9")


def test_other_frames_need_another_folder(folder):
    before = files_of(folder)
    folder.create(FRAMES)
    with pytest.raises(UserError, match="other frames; choose another folder"):
        folder.create(dataclasses.replace(FRAMES, default="KittingBox"))
    assert files_of(folder) == before


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
    folder.correct(folder.read(), Corrections(frames={Instance(1, 1): "KittingBox"}))
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
        assert after.corrections.frames == {Instance(1, 1): "KittingBox"}


def test_corrections_follow_their_demonstration(folder):
    read = folder.read()
    said = Corrections(
        frames={Instance(0, 1): "KittingBox", Instance(1, 1): "base_link"},
        turns={Instance(0, 3): 90.0, Instance(2, 3): None},
        orders={(Instance(0, 1), Instance(0, 5)): False, (Instance(1, 1), Instance(1, 3)): True},
        itself={"Bolt1": True},
    )
    folder.correct(read, said)
    assert folder.read().corrections == said
    folder.rename("demo1", "one")
    folder.delete("demo2")
    left = folder.read().corrections
    assert left == Corrections(
        frames={Instance(0, 1): "KittingBox"},
        turns={Instance(0, 3): 90.0, Instance(1, 3): None},
        orders={(Instance(0, 1), Instance(0, 5)): False},
        itself={"Bolt1": True},
    )
    folder.take_back(folder.read(), Corrections(frames={Instance(0, 1): ""}, turns={Instance(1, 3): 10.0}))
    assert folder.read().corrections == dataclasses.replace(left, frames={}, turns={Instance(0, 3): 90.0})
    folder.take_back(folder.read(), left)
    assert folder.read().corrections == Corrections()
    assert not {"chosen", "turns", "orders", "itself"} & yaml.safe_load((folder.path / "info.yaml").read_text()).keys()
    with pytest.raises(UserError, match="no frame 'PinkBox'; use one of"):
        folder.correct(folder.read(), Corrections(frames={Instance(0, 1): "PinkBox"}))
    with pytest.raises(UserError, match="no demonstration 'demo2'"):
        folder.correct(read, Corrections(turns={Instance(1, 1): None}))


@pytest.mark.parametrize(
    "said",
    [
        {"turns": {"demo1": {2: "left", 0: 90, "x": 90, 4: True}}, "orders": {"demo1": {2: 4}}, "itself": ["Bolt1"]},
        {"turns": [1], "orders": {"demo1": [2]}, "chosen": {"demo1": "KittingBox", "demo9": {2: "KittingBox"}}},
        {"chosen": {"demo1": {2: "PinkBox", 99: "KittingBox"}}, "itself": {"Bolt1": "yes"}},
    ],
)
def test_corrections_that_say_nothing_valid_are_left_out(folder, said):
    info = folder.path / "info.yaml"
    info.write_text(yaml.safe_dump({**yaml.safe_load(info.read_text()), **said}))
    assert folder.read().corrections == Corrections()


def test_it_is_known_in_which_task_was_recorded(folder, tmp_path):
    assert folder.frames().recorded == RecordedTask("stack3", {"YellowBox": 0.1, "GreenBox": 0.1, "BlueBox": 0.1})
    yumi = load_task("yumi_stack")
    with pytest.raises(UserError, match="objects of other sizes; choose another folder"):
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


def test_what_is_left_out_is_kept_and_not_read(folder):
    names = folder.names()
    folder.leave_out(names[0])
    assert folder.left_out() == (names[0],)
    assert folder.names() == names
    assert [one.name for one in folder.read()] == names[1:]
    folder.rename(names[0], "odd")
    assert folder.left_out() == ("odd",)
    folder.leave_out("odd", False)
    assert len(folder.read()) == len(names)
    for name in folder.names():
        folder.leave_out(name)
    with pytest.raises(UserError, match="is left out; take one in again"):
        folder.read()
    folder.delete("odd")
    assert "odd" not in folder.left_out()
    with pytest.raises(UserError, match="has no demonstration 'odd'"):
        folder.leave_out("odd")
