"""What is deleted can be restored as it was; nothing is overwritten, and nothing outside the folder is touched."""

import dataclasses
import json
from datetime import datetime

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.app.state.trash import Trash
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Frames
from bt_jax.tasks import load_task
from bt_jax.training.progress import locked
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

STACK = load_task("stack")
THINGS = (
    ("run", "one", ""),
    ("tree", "mine", ""),
    ("task", "own", ""),
    ("demonstrations", "top", ""),
    ("demonstration", "demo2", "top"),
)


def filled(root):
    workspace = Workspace(root)
    RunFolder.create(workspace.runs / "one", RunConfig(STACK, GPConfig(), Settings()))
    workspace.add_tree("mine", parse_tree("pick(YellowBox)"), STACK)
    workspace.save_task("own", STACK)
    folder = workspace.demonstration_set("top")
    folder.create(Frames.of(STACK3))
    for one in demonstrations(STACK3, STACKING):
        folder.append(one)
    return workspace


def files(workspace):
    """What lies in the workspace besides the trash."""
    return {
        path.relative_to(workspace.root): path.read_bytes()
        for path in workspace.root.rglob("*")
        if path.is_file() and "trash" not in path.relative_to(workspace.root).parts[:1]
    }


@settings(max_examples=15, deadline=None)
@given(st.permutations(THINGS), st.randoms(use_true_random=False))
def test_whatever_is_deleted_and_restored_is_as_it_was(tmp_path_factory, things, random):
    workspace = filled(tmp_path_factory.mktemp("page"))
    trash, before, gone = Trash(workspace), files(workspace), []
    for thing in things:
        if thing == THINGS[4] and THINGS[3] in [one for one, _ in gone]:
            continue  # its set is in the trash
        gone.append((thing, trash.put(*thing)))
    assert [one.id for one in trash.entries()] == [entry.id for _, entry in reversed(gone)]
    assert (workspace.run_names(), workspace.own_task_names()) == ([], [])
    assert (workspace.learnt_names(), workspace.demonstration_sets()) == ([], [])
    order = sorted(gone, key=lambda one: (one[0][0] == "demonstration", random.random()))  # after its set
    for thing, entry in order:
        assert trash.restore(entry.id) == thing[:2]
    assert files(workspace) == before
    assert trash.entries() == []


def test_what_has_the_name_by_now_stays_and_the_restored_thing_gets_a_number(tmp_path):
    workspace = filled(tmp_path)
    trash = Trash(workspace)
    entries = [trash.put(*thing) for thing in THINGS if thing[0] != "demonstrations"]
    filled(tmp_path / "other")
    for kind, name, of in (thing for thing in THINGS if thing[0] != "demonstrations"):
        place = {"task": f"tasks/{name}.yaml", "demonstration": f"demonstrations/{of}/{name}"}.get(kind, f"runs/{name}")
        (tmp_path / "other" / place).rename(tmp_path / place)
    here = files(workspace)
    assert [trash.restore(entry.id)[1] for entry in entries] == ["one-2", "mine-2", "own-2", "demo2-2"]
    assert here.items() <= files(workspace).items()
    assert workspace.task("own-2").targets == STACK.targets


def test_a_demonstration_waits_for_its_set(tmp_path):
    trash = Trash(filled(tmp_path))
    one, whole = trash.put("demonstration", "demo2", "top"), trash.put("demonstrations", "top")
    with pytest.raises(UserError, match="the set top of demo2 is not there; restore it first"):
        trash.restore(one.id)
    trash.restore(whole.id)
    assert trash.restore(one.id) == ("demonstration", "demo2")


def test_emptied_it_is_gone_for_good(tmp_path):
    workspace = filled(tmp_path)
    trash = Trash(workspace)
    assert trash.empty() == 0
    entry = trash.put("run", "one")
    assert (entry.kind, entry.name, entry.when.date()) == ("run", "one", datetime.now().date())
    (trash.path / "something else").mkdir()
    assert trash.empty() == 1
    assert not trash.path.exists()
    with pytest.raises(UserError, match="no longer in the trash"):
        trash.restore(entry.id)


def test_what_is_in_use_or_gone_or_elsewhere_is_not_deleted(tmp_path):
    workspace = filled(tmp_path / "mine")
    trash, outside = Trash(workspace), tmp_path / "outside"
    RunFolder.create(outside, RunConfig(STACK, GPConfig(), Settings()))
    (workspace.runs / "link").symlink_to(outside)
    before = files(workspace)
    refused = [
        ("run", "gone", "no longer there"),
        ("run", "link", "leads out"),
        ("task", "stack", "comes with the package"),
    ]
    refused += [(kind, name, "cannot name anything") for kind, _, _ in THINGS[:4] for name in ("..", "", "a/b", ".x")]
    for kind, name, says in refused:
        with pytest.raises(UserError, match=says):
            trash.put(kind, name)
    for of in ("..", "../../outside"):
        with pytest.raises(UserError, match="cannot name anything"):
            trash.put("demonstration", "demo1", of)
    with locked(workspace.runs / "one"), pytest.raises(UserError, match="is evolving; stop it before you delete it"):
        trash.put("run", "one")
    (workspace.runs / "one" / ".lock").unlink(missing_ok=True)
    assert before.items() <= files(workspace).items()
    assert trash.entries() == []
    assert outside.is_dir()


@pytest.mark.parametrize(
    "change",
    [
        {"name": "../../x"},
        {"kind": "door"},
        {"when": "soon"},
        {"kind": "demonstration", "set": ".."},
        {"name": "other"},
    ],
)
def test_an_entry_that_lies_is_left_out(tmp_path, change):
    trash = Trash(filled(tmp_path))
    entry = trash.put("run", "one")
    source = trash.path / entry.id / "entry.json"
    source.write_text(json.dumps({**json.loads(source.read_text()), **change}))
    assert trash.entries() == []
    with pytest.raises(UserError):
        trash.restore(entry.id)
    assert not (tmp_path / "runs" / "one").exists()


def test_two_of_one_name_lie_side_by_side(tmp_path):
    workspace = filled(tmp_path)
    trash = Trash(workspace)
    first = trash.put("task", "own")
    workspace.save_task("own", dataclasses.replace(STACK, description="another"))
    second = trash.put("task", "own")
    assert {one.id for one in trash.entries()} == {first.id, second.id}
    assert [trash.restore(one.id)[1] for one in (second, first)] == ["own", "own-2"]
    assert workspace.task("own").description == "another"
