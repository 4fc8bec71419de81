"""A kit as one file: what was put in comes out again, and what does not belong there is refused before it is unpacked."""

import contextlib
import dataclasses
import io
import json
import stat
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.lfd import DemonstrationFolder
from bt_jax.lfd.evaluation.synthetic import demonstration_set
from bt_jax.tasks import Target, load_task, task_names
from bt_jax.teaching.kit_file import KitFile, read_set, write_set

STACK = load_task("stack")
TREES = ["move(YellowBox, (0, 0, 0.055), KittingBox)", "Sequence(pick(GreenBox), open_gripper())", "clear(GreenBox)"]
NAMES = st.from_regex(r"[A-Za-z0-9_ü][A-Za-z0-9_ .+-]{0,20}", fullmatch=True)


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory):
    """A set whose information names a run on this machine."""
    folder = DemonstrationFolder(tmp_path_factory.mktemp("demonstrations") / "first")
    on_yellow = Target("GreenBox", (0.0, 0.0, 0.1), "YellowBox")
    shown = demonstration_set(STACK, [on_yellow], count=2, rng=np.random.default_rng(0), noise=0.003)
    folder.create(shown.frames)
    for one in shown.demonstrations:
        folder.append(one)
    folder.remember_run(folder.path)
    return folder


@settings(max_examples=8, deadline=None)
@given(
    name=st.sampled_from(task_names()),
    sets=st.lists(NAMES, max_size=2, unique_by=str.casefold),
    trees=st.dictionaries(NAMES, st.sampled_from(TREES), max_size=3),
)
def test_what_is_packed_is_unpacked_again(demonstrations, name, sets, trees):
    task = dataclasses.replace(load_task(name), description="handed on")
    trees = {} if task.object_names != STACK.object_names else trees
    if len({one.casefold() for one in trees}) < len(trees):
        return
    files = read_set(demonstrations)
    kit = KitFile(task, dict.fromkeys(sets, files), {one: parse_tree(text) for one, text in trees.items()})
    packed = kit.pack()
    assert KitFile.unpack(packed, "a kit") == kit
    assert kit.pack() == packed


def test_a_set_is_as_it_was_but_for_where_its_run_lay(demonstrations, tmp_path):
    kit = KitFile.unpack(KitFile(STACK, {"mine": read_set(demonstrations)}).pack(), "a kit")
    write_set(kit.sets["mine"], tmp_path / "mine")
    folder = DemonstrationFolder(tmp_path / "mine")
    assert folder.read() == demonstrations.read()
    assert folder.task() == demonstrations.task()
    assert (folder.run(), "after" in (folder.path / "info.yaml").read_text()) == (None, False)


def zipped(parts, **options):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, **options) as archive:
        for name, data in parts:
            archive.writestr(name, data)
    return buffer.getvalue()


def parts(**changed):
    """The parts of a kit with a tree, some of them replaced (None: left out), by the first word of their names."""
    with zipfile.ZipFile(io.BytesIO(KitFile(STACK, trees={"mine": parse_tree(TREES[0])}).pack())) as archive:
        found = {name: archive.read(name) for name in archive.namelist()}
    for word, data in changed.items():
        (name,) = [name for name in found if name.startswith(word)]
        found[name] = data
    return [(name, data) for name, data in found.items() if data is not None]


def link():
    info = zipfile.ZipInfo("trees/link.txt")
    info.external_attr = (stat.S_IFLNK | 0o777) << 16
    return info


OUTSIDE = [
    "../x",
    "/etc/x",
    "trees/../../x.txt",
    "trees/a/b.txt",
    "trees/..txt",
    "trees\\..\\x.txt",
    "trees/.x.txt",
    "demonstrations/../info.yaml",
    "demonstrations/a/../info.yaml",
    "demonstrations/a/../../data_1.yaml",
    "demonstrations/a/b/c/data_1.yaml",
    "demonstrations/a/run.sh",
    "runs/a/config.json",
    "C:x.txt",
    "trees/a.txt\n",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_a_part_that_would_lie_elsewhere_is_refused(name):
    with pytest.raises(UserError, match=r"kit\.zip cannot be opened: it holds '.*', which is no part of a kit"):
        KitFile.unpack(zipped([*parts(), (name, b"x")]), "kit.zip")


@settings(max_examples=25, deadline=None)
@given(
    name=st.text(min_size=1, max_size=20)
    | st.lists(st.sampled_from(["..", "/", "\\", "trees", "a", ".txt"]), min_size=1).map("".join)
)
def test_whatever_a_part_is_called_it_lies_in_a_kit_or_is_refused(name):
    try:
        kit = KitFile.unpack(zipped([*parts(), (name, TREES[0])]), "kit.zip")
    except (UserError, UnicodeEncodeError):
        return
    assert all("/" not in one and "\\" not in one and not one.startswith(".") for one in kit.trees)


BOMB = b" " * 3_000_000
HOSTILE = {
    "a link": ([*parts(), (link(), "/etc/passwd")], "no part of a kit"),
    "two of a name": ([*parts(), ("trees/MINE.txt", TREES[0])], "two parts of the same name"),
    "a part that is large once unpacked": ([*parts(), ("trees/big.txt", BOMB)], "a part of more than 2 MB"),
    "much in all": ([*parts(), *[(f"trees/t{i}.txt", BOMB[:1_900_000]) for i in range(53)]], "more than 100 MB"),
    "many parts": ([*parts(), *[(f"trees/t{i}.txt", b"") for i in range(5000)]], "parts; share fewer"),
    "no head": (parts(kit=None), "no kit.json"),
    "a damaged head": (parts(kit=b"{"), "kit.json is damaged"),
    "an endless head": (parts(kit=b"[" * 100_000), "kit.json is damaged"),
    "another format": (parts(kit=json.dumps({"format": 9, "version": "8.0"})), "format 9 and this version reads 1"),
    "no task": (parts(task=None), "no task.yaml"),
    "a task that extends another": (parts(task=b"extends: ../../secret.yaml"), "task.yaml extends another task"),
    "a task that is none": (parts(task=b"targets: ["), r"task\.yaml"),
    "a task in bytes": (parts(task=b"\xff\xfe\xff"), "no text in UTF-8"),
    "a tree that is none": (parts(trees=b"dance()"), r"trees/mine\.txt: .*dance"),
    "a tree of something else": (parts(trees=b"pick(PinkBox)"), "the tree mine: .*PinkBox"),
    "a tree without end": (parts(trees=b"Sequence(" * 5000), "nested too deeply"),
    "demonstrations without frames": (
        [*parts(), ("demonstrations/a/demo1/data_1.yaml", b"type: pick")],
        r"the demonstrations a have no info\.yaml",
    ),
    "demonstrations that extend a task": (
        [*parts(), ("demonstrations/a/task.yaml", b"extends: /etc/x.yaml")],
        "extends another task",
    ),
    "demonstrations that are none": ([*parts(), ("demonstrations/a/info.yaml", b"frames: 3")], r"a/info\.yaml"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_file_is_refused_in_a_sentence(what):
    content, says = HOSTILE[what]
    with pytest.raises(UserError, match=says) as refused:
        KitFile.unpack(zipped(content), "kit.zip")
    assert str(refused.value).startswith("kit.zip cannot be opened: ")
    assert "\n" not in str(refused.value)
    assert "/tmp" not in str(refused.value)


@settings(max_examples=25, deadline=None)
@given(st.data())
def test_a_damaged_file_is_refused_or_read(data):
    good = bytearray(zipped(parts()))
    for _ in range(data.draw(st.integers(1, 4))):
        good[data.draw(st.integers(0, len(good) - 1))] = data.draw(st.integers(0, 255))
    kept = bytes(good[: data.draw(st.integers(0, len(good)))]) if data.draw(st.booleans()) else bytes(good)
    with contextlib.suppress(UserError):  # any other exception fails
        KitFile.unpack(kept, "kit.zip")


def test_what_could_not_be_opened_is_not_saved(demonstrations):
    for kit, says in (
        (KitFile(STACK, {"../up": read_set(demonstrations)}), "cannot name anything"),
        (KitFile(STACK, trees={"other": parse_tree("pick(PinkBox)")}), "PinkBox"),
        (KitFile(STACK, {"empty": {}}), "record them again"),
    ):
        with pytest.raises(UserError, match=says):
            kit.pack()
