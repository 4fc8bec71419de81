"""Trees that are imported, kits that are saved and opened, and things that are thrown away, as the page does it."""

import asyncio
import dataclasses
import json

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml import to_xml
from bt_jax.gp.config import GPConfig
from bt_jax.lfd import Frames
from bt_jax.tasks import load_task
from bt_jax.teaching.kit_file import KitFile
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.run_note import RunNote, read_note
from bt_jax.training.settings import Settings
from tests.helpers.demonstrations import STACK3, STACKING, demonstrations

STACK = load_task("stack")
TREE = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), open_gripper())")
FILES = {
    "mine.txt": str(TREE),
    "mine.XML": to_xml(TREE),
    "mine.json": json.dumps({"tree": str(TREE)}),
}


def heard(studio):
    """The topics that are announced from now on."""
    found = []
    for topic in ("runs", "task", "demonstrations", "trash"):
        studio.bus.subscribe(topic, lambda topic=topic: found.append(topic))
    return found


@pytest.mark.parametrize("file", FILES)
def test_a_tree_is_imported_from_any_format(studio, file):
    said = heard(studio)
    names = [asyncio.run(studio.keeping.import_tree(file, FILES[file].encode(), STACK)) for _ in range(2)]
    assert names == ["mine", "mine-2"]
    assert [studio.workspace.learnt_tree(name) for name in names] == [TREE, TREE]
    assert studio.workspace.learnt_task("mine") == STACK
    assert said == ["runs", "runs"]


@pytest.mark.parametrize(
    ("file", "content", "says"),
    [
        ("mine.txt", b"Sequence(pick(YellowBox)", r"mine\.txt, "),
        ("mine.xml", b"<root>", r"mine\.xml"),
        ("mine.json", b"[]", r"mine\.json says no tree"),
        ("mine.txt", b"pick(PinkBox)", r"mine\.txt: .*PinkBox"),
        ("mine.txt", b"\xff\x00", r"mine\.txt"),
        ("mine.exe", b"MZ", r"mine\.exe is no tree; choose a file whose name ends in \.txt, \.xml, \.json"),
        ("mine.txt", b" " * 2_000_000, "larger than 1 MB"),
        ("../../mine.exe", b"", r"^mine\.exe is no tree"),
    ],
)
def test_a_file_that_is_no_tree_of_the_task_is_one_sentence(studio, file, content, says):
    with pytest.raises(UserError, match=says) as refused:
        asyncio.run(studio.keeping.import_tree(file, content, STACK))
    assert "/tmp" not in str(refused.value)
    assert "\n" not in str(refused.value)
    assert studio.workspace.learnt_names() == []


def test_a_name_from_elsewhere_names_only_a_folder_here(studio):
    names = [
        asyncio.run(studio.keeping.import_tree(file, str(TREE).encode(), STACK))
        for file in ("../../etc/my tree?.txt", "....txt", "\N{GREEK SMALL LETTER ALPHA}.txt")
    ]
    assert names == ["my tree", "tree", "\N{GREEK SMALL LETTER ALPHA}"]
    assert {path.name for path in studio.workspace.runs.iterdir()} == {*names}


def with_things(root):
    studio = Studio(Workspace(root), STACK3)
    workspace = studio.workspace
    own = dataclasses.replace(STACK3, name="mine", description="of the second shift")
    workspace.save_task("mine", own)
    RunFolder.create(workspace.runs / "run", RunConfig(own, GPConfig(), Settings())).save_tree(TREE, title="")
    workspace.add_tree("other", parse_tree("pick(BlueBox)"), own)
    folder = workspace.demonstration_set("top")
    folder.create(Frames.of(STACK3))
    for one in demonstrations(STACK3, STACKING):
        folder.append(one)
    return studio, own


def test_a_kit_is_the_same_in_another_folder(tmp_path):
    studio, own = with_things(tmp_path / "here")
    data = asyncio.run(studio.keeping.save_kit(own, ["top"], ["run", "other"]))
    there = Studio(Workspace(tmp_path / "there"), STACK)
    said = heard(there)
    opened = asyncio.run(there.keeping.open_kit("line.kit.zip", data))
    assert (opened.task, opened.sets, opened.trees) == ("mine", ("top",), ("run", "other"))
    assert said == ["task", "runs", "demonstrations"]
    workspace = there.workspace
    assert workspace.task("mine") == own
    assert workspace.demonstration_set("top").read() == studio.workspace.demonstration_set("top").read()
    assert (workspace.learnt_tree("run"), workspace.learnt_task("run")) == (TREE, own)
    assert asyncio.run(there.keeping.save_kit(own, opened.sets, opened.trees)) == data


def test_what_a_kit_brings_replaces_nothing(tmp_path):
    studio, own = with_things(tmp_path)
    data = asyncio.run(studio.keeping.save_kit(own, ["top"], ["run"]))
    again = asyncio.run(studio.keeping.open_kit("line.kit.zip", data))
    assert (again.task, again.sets, again.trees) == ("mine", ("top-2",), ("run-2",))  # the task is the same
    other = dataclasses.replace(own, description="changed")
    studio.workspace.save_task("mine", other)
    third = asyncio.run(studio.keeping.open_kit("line.kit.zip", data))
    assert (third.task, third.sets, third.trees) == ("mine-2", ("top-3",), ("run-3",))
    assert studio.workspace.task("mine") == other
    assert studio.workspace.task("mine-2").description == own.description
    packaged = KitFile(dataclasses.replace(STACK, description="ours")).pack()
    assert asyncio.run(studio.keeping.open_kit("a.kit.zip", packaged)).task == "stack-2"
    assert asyncio.run(studio.keeping.open_kit("a.kit.zip", KitFile(STACK).pack())).task == "stack"
    long = KitFile(dataclasses.replace(STACK, name=100 * "x")).pack()
    assert asyncio.run(studio.keeping.open_kit("a.kit.zip", long)).task == 56 * "x"
    odd = KitFile(dataclasses.replace(STACK, name="../../x")).pack()
    with pytest.raises(UserError, match="is not a name"):
        asyncio.run(studio.keeping.open_kit("a.kit.zip", odd))


def test_a_kit_that_cannot_be_opened_leaves_nothing(studio):
    with pytest.raises(UserError, match=r"^line\.kit\.zip cannot be opened: it is no zip file"):
        asyncio.run(studio.keeping.open_kit("line.kit.zip", b"PK"))
    assert [path.name for path in studio.workspace.root.iterdir()] == []


def test_a_kit_without_what_was_chosen_is_a_sentence(tmp_path):
    studio, own = with_things(tmp_path)
    RunFolder.create(studio.workspace.runs / "new", RunConfig(own, GPConfig(), Settings()))
    for task, sets, trees, says in (
        (own, ["gone"], [], "gone"),
        (own, [], ["gone"], "no longer there"),
        (own, [], ["new"], "new has no tree yet"),
        (load_task("kit4"), [], ["other"], "the tree other: .*BlueBox"),
    ):
        with pytest.raises(UserError, match=says):
            asyncio.run(studio.keeping.save_kit(task, sets, trees))


def test_a_run_is_named_and_what_is_thrown_away_comes_back(tmp_path):
    studio, _ = with_things(tmp_path)
    said = heard(studio)
    asyncio.run(studio.keeping.note("run", RunNote("good", "for Monday")))
    assert read_note(studio.workspace.run("run").path) == RunNote("good", "for Monday")
    asyncio.run(studio.delete_run("run"))
    (entry,) = studio.keeping.trash.entries()
    assert asyncio.run(studio.keeping.restore(entry.id)) == "run"
    assert read_note(studio.workspace.run("run").path).name == "good"
    assert said == ["runs", "runs", "trash", "runs", "runs", "trash"]
    assert asyncio.run(studio.keeping.empty()) == 0


def test_the_edited_task_outlives_its_file(tmp_path):
    studio, own = with_things(tmp_path)
    studio.open_task(studio.workspace.task("mine"))
    assert not studio.unsaved
    asyncio.run(studio.delete_task("mine"))
    assert (studio.unsaved, studio.workspace.draft()) == (True, own)
    with pytest.raises(UserError, match="comes with the package"):
        asyncio.run(studio.delete_task("stack"))
