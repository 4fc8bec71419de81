"""Names come from the browser: whatever they are, no path leaves the workspace."""

import dataclasses
import shutil

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.run_record import read_records
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Frames
from bt_jax.tasks import load_task
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

STACK = load_task("stack")
OUTSIDE = [
    "..",
    ".",
    "",
    "../runs",
    "/etc",
    "a/b",
    "a\\..\\b",
    "a/../../b",
    "\x00",
    ".hidden",
    "-option",
    "x" * 200,
    "a\n",
]


def run_in(workspace, name="one"):
    return RunFolder.create(workspace.runs / name, RunConfig(STACK, GPConfig(), Settings()))


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_name_that_leads_out_is_refused(tmp_path, name):
    workspace = Workspace(tmp_path)
    for read in (workspace.run, workspace.learnt_task, workspace.demonstration_set, workspace.task):
        with pytest.raises(UserError, match="cannot name anything here; use letters"):
            read(name)
    with pytest.raises(UserError):
        workspace.save_task(name, STACK)
    assert list(tmp_path.iterdir()) == []


@given(
    name=st.text(max_size=30) | st.lists(st.sampled_from(["..", ".", "/", "\\", "a", "runs"]), max_size=6).map("".join)
)
def test_whatever_the_name_no_path_leaves_its_folder(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp() / "workspace" / "runs"
    workspace = Workspace(folder.parent)
    try:
        path = workspace.inside(folder, name)
    except UserError:
        return
    assert path.resolve().parent == folder.resolve()


def test_a_link_to_elsewhere_is_neither_listed_nor_followed(tmp_path):
    workspace, elsewhere = Workspace(tmp_path / "mine"), Workspace(tmp_path / "other")
    kept = run_in(elsewhere)
    run_in(workspace, "two")
    (workspace.runs / "link").symlink_to(kept.path)
    assert workspace.run_names() == ["two"]
    with pytest.raises(UserError, match="leads out"):
        workspace.run("link")
    assert (kept.path / "config.json").is_file()


def test_runs_and_demonstrations_are_listed_and_found(tmp_path):
    workspace = Workspace(tmp_path)
    assert (workspace.run_names(), workspace.demonstration_sets()) == ([], [])
    run_in(workspace, "stack-1")
    (workspace.runs / "no run").mkdir()
    assert workspace.run_names() == ["stack-1"]
    assert workspace.run("stack-1").config().task == STACK
    workspace.demonstration_set("top").create(Frames.of(STACK))
    assert workspace.demonstration_sets() == ["top"]
    shutil.rmtree(workspace.runs / "stack-1")
    with pytest.raises(UserError, match="no longer there"):
        workspace.run("stack-1")


@pytest.mark.parametrize("content", [b"", b"[" * 6000, b"\xff", b"{}", b'{"format": 2, "task": 3}'])
def test_a_run_that_cannot_be_read_hides_no_other(tmp_path, content):
    workspace = Workspace(tmp_path)
    for name in ("one", "two", "three"):
        run_in(workspace, name)
    (workspace.runs / "two" / "config.json").write_bytes(content)
    records, problems = read_records(workspace)
    assert set(records) == {"one", "three"}
    assert set(problems) == {"two"}
    assert "config.json" in str(problems["two"])


@pytest.mark.parametrize("name", ["result.json", "progress.json", "history.csv", "best_tree.txt", "config-1.json"])
@pytest.mark.parametrize("content", [b"", b"[" * 6000, b"\xff", b"{}", b'{"test_layouts": "x", "success_rate": 1.0}'])
def test_a_run_is_listed_whatever_its_other_files_hold(tmp_path, name, content):
    workspace = Workspace(tmp_path)
    (run_in(workspace).path / name).write_bytes(content)
    records, problems = read_records(workspace)
    assert (set(records), problems) == ({"one"}, {})
    assert (records["one"].result, records["one"].tree) == (None, None)


def test_a_saved_task_is_read_back(tmp_path):
    workspace = Workspace(tmp_path)
    target = dataclasses.replace(STACK.targets[0], position=(0.1, 0.05, 0.052))
    task = dataclasses.replace(STACK, targets=(target,))
    workspace.save_task("mine", task)
    assert workspace.task("mine") == dataclasses.replace(task, name="mine")
    assert "mine" in workspace.task_names()
    with pytest.raises(UserError, match="another name"):
        workspace.save_task("stack", task)


@pytest.mark.parametrize("text", ["targets: [", "- a list", "extends: nothing", "extends: stack\nboxes: 3\n", "\x00"])
def test_a_broken_task_file_is_a_sentence(tmp_path, text):
    workspace = Workspace(tmp_path)
    workspace.tasks.mkdir(parents=True)
    (workspace.tasks / "broken.yaml").write_text(text)
    with pytest.raises(UserError, match=r"broken\.yaml"):
        workspace.task("broken")


def test_trees_that_were_learnt_on_the_command_line_are_found(tmp_path):
    workspace = Workspace(tmp_path)
    run_in(workspace)
    folder = workspace.runs / "learn-demos"
    folder.mkdir()
    (folder / "learnt_tree.txt").write_text("pick(YellowBox)\n")
    assert workspace.learnt_names() == ["learn-demos"]
    assert str(workspace.learnt_tree("learn-demos")) == "pick(YellowBox)"
    with pytest.raises(UserError):
        workspace.learnt_tree("../one")
    with pytest.raises(UserError, match="no file"):
        workspace.learnt_tree("gone")
    assert workspace.learnt_task("learn-demos") is None
    names = [workspace.add_tree("mine", parse_tree("pick(BlueBox)"), STACK) for _ in range(2)]
    assert names == ["mine", "mine-2"]
    assert {*workspace.learnt_names()} == {"learn-demos", *names}
    assert (str(workspace.learnt_tree("mine-2")), workspace.learnt_task("mine-2")) == ("pick(BlueBox)", STACK)
    assert workspace.run_names() == ["one"]


def test_what_files_hold_is_read_again_only_if_they_have_changed(tmp_path, monkeypatch):
    workspace, read = Workspace(tmp_path), []
    workspace.save_task("mine", STACK)
    run = RunFolder.create(workspace.runs / "run", RunConfig(STACK, GPConfig(), Settings()))
    mine = workspace.task("mine")
    for name, real in (("load_task", load_task), ("RunConfig.read", RunConfig.read)):
        where = "bt_jax.app.state.workspace." if name == "load_task" else "bt_jax.training.run_config."
        monkeypatch.setattr(where + name, lambda path, real=real, **options: read.append(path) or real(path, **options))
    for _ in range(3):
        assert workspace.holds(mine)
        assert workspace.run_holds("run", STACK)
        assert not workspace.run_holds("run", mine)
    assert len(read) == 2
    other = dataclasses.replace(mine, description="another")
    workspace.save_task("mine", other)
    run.save_config(RunConfig(mine, GPConfig(), Settings()))
    assert (workspace.holds(mine), workspace.holds(other)) == (False, True)
    assert (workspace.run_holds("run", STACK), workspace.run_holds("run", mine)) == (False, True)
    shutil.rmtree(run.path)
    assert not workspace.run_holds("run", mine)
    (workspace.tasks / "extended.yaml").write_text("extends: mine.yaml\nname: extended\n")
    extended = workspace.task("extended")
    assert workspace.holds(extended)
    workspace.save_task("mine", dataclasses.replace(mine, targets=mine.targets[:1]))
    assert not workspace.holds(extended)
