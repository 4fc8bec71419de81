import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig, Selection
from bt_jax.gp.evolution import Generation, Population, State
from bt_jax.tasks import load_task, task_names
from bt_jax.training.checkpoint import Checkpoint
from bt_jax.training.history import history_csv, read_history
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.samples import assert_same
from tests.helpers.strategies import trees as random_trees

TREE = parse_tree("Sequence(move(YellowBox, (0, 0, 0.055), KittingBox), open_gripper)")
CONFIG = RunConfig(load_task("stack"), GPConfig(), Settings())
LEAVES = gene_pool(CONFIG.task).leaves
floats = st.floats(-1e6, 1e6)
rows = st.builds(
    Generation,
    **{f.name: st.integers(0, 10**6) if f.type == "int" else floats for f in dataclasses.fields(Generation)},
)


def config(runs=2, **changes):
    """The configuration of a run whose state is `state(runs)`."""
    return dataclasses.replace(CONFIG, gp=GPConfig(population=8, max_nodes=16, runs=runs), **changes)


def state(runs=2):
    """A state of trees of one leaf."""
    rng = np.random.default_rng(0)
    tokens = rng.integers(3, 60, (runs, 8, 16)).astype(np.int16)
    trees = Trees(jax.numpy.asarray(tokens), jax.numpy.ones((runs, 8, 16), jax.numpy.uint8))
    fitness = jax.numpy.asarray(rng.normal(size=(runs, 8)).astype(np.float32))
    seen = tuple(np.sort(rng.integers(0, 2**63, 5 + r).astype(np.uint64)) for r in range(runs))
    return State(Population(trees, fitness), 7, fitness[:, 0], seen, tuple(range(3, 3 + runs)))


@pytest.fixture
def saved(tmp_path):
    """The folder of a run of two with a checkpoint."""
    folder = RunFolder.create(tmp_path / "saved", config())
    folder.save_checkpoint(Checkpoint(state(), LEAVES, 0, [], config()))
    return folder


@pytest.fixture
def folder(tmp_path):
    return RunFolder.create(tmp_path / "run", CONFIG)


@pytest.mark.parametrize("name", task_names())
def test_the_configuration_is_read_back(tmp_path, name):
    config = RunConfig(
        load_task(name),
        GPConfig(method="population", population=20, parent_selection=Selection.RANK, baseline_index=1, elites=3),
        Settings(level="kinematic", layouts=3),
        TREE,
        extra_leaves=(parse_tree("subtask(aside, Sequence(move(BlueBox, (0, 0, 0.3), KittingBox), open_gripper))"),),
        phase=2,
        since=50,
        without=(parse_tree("move(BlueBox, (0, 0, 0.05), GreenBox)"), parse_tree("open_gripper")),
    )
    found = RunFolder.create(tmp_path / "run", config).config()
    assert found == config
    assert isinstance(found.gp.parent_selection, Selection)
    found.gp.check()


@given(st.lists(rows, max_size=5))
def test_history_is_read_back_and_written_the_same(history):
    text = history_csv(history)
    again = read_history(text)
    assert history_csv(again) == text
    for ours, theirs in zip(again, history, strict=True):
        for a, b in zip(dataclasses.astuple(ours), dataclasses.astuple(theirs), strict=True):
            assert a == pytest.approx(b, abs=1e-4)


@pytest.mark.parametrize("runs", [1, 2])
def test_the_checkpoint_is_read_back(tmp_path, runs):
    folder = RunFolder.create(tmp_path / "run", config(runs, phase=3))
    assert folder.load_checkpoint() is None
    saved, history = state(runs), [Generation(0, 7, 8, -1.5, -2.0, 0.5, 3, 0.25, 1.0, 1, 2)]
    folder.save_checkpoint(Checkpoint(saved, LEAVES, 3, history, config(runs, phase=3)))
    checkpoint = folder.load_checkpoint()
    found = checkpoint.state
    assert (checkpoint.history, checkpoint.symbols, checkpoint.phase) == (history, LEAVES, 3)
    assert checkpoint.config == config(runs, phase=3)
    assert found.generation == 7
    assert_same(
        (found.population, found.baseline_fitness, found.seen), (saved.population, saved.baseline_fitness, saved.seen)
    )
    assert found.trees_measured == saved.trees_measured


@pytest.mark.parametrize("damage", ["empty", "half", "flipped", "text"])
def test_a_damaged_checkpoint_is_named(saved, damage):
    path = saved.path / "checkpoint.npz"
    data = path.read_bytes()
    middle = len(data) // 2
    flipped = data[:middle] + bytes(255 - b for b in data[middle : middle + 50]) + data[middle + 50 :]
    path.write_bytes({"empty": b"", "half": data[:middle], "flipped": flipped, "text": b"hello\n" * 100}[damage])
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        saved.load_checkpoint()


def text(content):
    return np.frombuffer(content, np.uint8)


@pytest.mark.parametrize(
    "change",
    [
        {"history": text(b"run,generation\n0,1\n")},
        {"history": text(b"run,luck\n0,1\n")},
        {"history": text(history_csv([Generation(0, 6, 8, -1.5, -2.0, 0.5, 3, 0.25, 1.0, 1, 2)]).encode())},
        {"generation": np.array([1, 2])},
        {"generation": np.array(7.5)},
        {"leaves": text(b"pick(")},
        {"leaves": text(b"nonsense(YellowBox)")},
        {"leaves": text(b"pick(YellowBox)")},  # fewer than there are tokens
        {"config": text(b"[" * 6000)},
        {"fitness": np.zeros((2, 9), np.float32)},
        {"fitness": np.zeros((2, 8), np.float64)},
        {"fitness": np.array([[None] * 8] * 2, object)},
        {"sizes": np.zeros((2, 8, 16), np.uint8)},
        {"sizes": np.full((2, 8, 16), 17, np.uint8)},
        {"tokens": np.full((2, 8, 16), -1, np.int16)},
        {"counts": np.array([3])},
    ],
)
def test_a_checkpoint_with_wrong_content_is_named(saved, change):
    path = saved.path / "checkpoint.npz"
    with np.load(path) as data:
        arrays = {**data, **change}
    np.savez(path, **arrays)
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        saved.load_checkpoint()


@pytest.mark.parametrize(("at", "value"), [(6, 92), (8, 1), (10, 99)])  # version, encrypted, compressed by a method
def test_a_checkpoint_that_zipfile_cannot_read_is_named(saved, at, value):
    path = saved.path / "checkpoint.npz"
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + at] = value  # of its first entry
    path.write_bytes(data)
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        saved.load_checkpoint()


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (b'{"format": 99}', "has format 99 and this version reads 2; use the version that wrote it"),
        (b'{"version": "99.0"}', "checkpoint.npz was written by version 99.0 and this is"),
        (b"{}", "checkpoint.npz, key format"),
    ],
)
def test_a_checkpoint_of_another_version_is_not_called_damaged(saved, config, message):
    path = saved.path / "checkpoint.npz"
    with np.load(path) as data:
        arrays = {**data, "config": text(config)}
    np.savez(path, **arrays)
    with pytest.raises(UserError) as raised:
        saved.load_checkpoint()
    assert message in str(raised.value)
    assert "damaged" not in str(raised.value)


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (PermissionError(13, "Permission denied"), "cannot be read (Permission denied)"),
        (OSError(5, "Input/output error"), "cannot be read (Input/output error)"),
        (MemoryError(), "needs more memory than there is"),
    ],
)
def test_a_checkpoint_that_the_system_does_not_give_is_not_called_damaged(saved, monkeypatch, problem, message):
    def refuse(*_, **__):
        raise problem

    monkeypatch.setattr(*((np, "load") if isinstance(problem, MemoryError) else (Path, "read_bytes")), refuse)
    with pytest.raises(UserError) as raised:
        saved.load_checkpoint()
    assert message in str(raised.value)
    assert "damaged" not in str(raised.value)


def test_an_archive_of_something_else_is_no_checkpoint(saved):
    np.savez(saved.path / "checkpoint.npz", measured=np.zeros(3))
    with pytest.raises(
        UserError, match=r"checkpoint.npz is no checkpoint of train; delete it to start this run again$"
    ):
        saved.load_checkpoint()


def test_an_older_checkpoint_does_not_say_its_configuration(saved):
    saved.save_checkpoint(Checkpoint(state(), LEAVES, 0, []))
    assert saved.load_checkpoint().config is None


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"gp": {"population": 16}}, "the checkpoint says population 8 and the configuration 16"),
        ({"gp": {"seed": 5}}, "the checkpoint says seed 0 and the configuration 5"),
        ({"gp": {"p_add": 0.2, "p_change": 0.3}}, "the checkpoint says p_add 0.1 and the configuration 0.2"),
        ({"settings": {"draws": 2}}, "the checkpoint says draws 5 and the configuration 2"),
        ({"task": {"name": "other"}}, "task differs"),
        ({"baseline": str(TREE)}, "baseline differs"),
        ({"x64": True}, "the checkpoint says x64 False and the configuration True"),
    ],
)
def test_a_configuration_that_contradicts_the_checkpoint_is_refused(saved, changes, problem):
    path = saved.path / "config.json"
    data = json.loads(path.read_text())
    for name, change in changes.items():
        data[name] = {**data[name], **change} if isinstance(change, dict) else change
    path.write_text(json.dumps(data))
    with pytest.raises(UserError, match=rf"checkpoint.npz and .*config.json are not of one run: {problem}; restore"):
        saved.load_checkpoint()


def test_a_checkpoint_of_a_later_phase_is_refused(saved):
    saved.save_checkpoint(Checkpoint(state(), LEAVES, 1, [], config(phase=1)))
    with pytest.raises(UserError, match="the checkpoint is of phase 1 and the configuration of phase 0"):
        saved.load_checkpoint()


def test_the_tree_is_kept_in_three_formats(folder):
    with pytest.raises(UserError, match=r"holds no tree yet.*--resume"):
        folder.tree()
    folder.save_tree(TREE, title="a <tree> & more")
    assert folder.tree() == TREE
    assert from_xml((folder.path / "best_tree.xml").read_text()) == TREE
    assert "<svg" in (folder.path / "best_tree.svg").read_text()


def test_a_simplified_tree_stays_only_beside_the_tree_that_it_was_made_from(folder):
    folder.save_tree(TREE, title="")
    paths = folder.save_simplified(TREE, title="")
    assert {path.name for path in paths} == {f"simplified_tree.{suffix}" for suffix in ("txt", "xml", "svg")}
    folder.save_tree(TREE, title="the same")
    assert all(path.is_file() for path in paths)
    folder.save_tree(parse_tree("open_gripper"), title="another")
    assert not any(path.exists() for path in paths)


@given(tree=random_trees())
def test_every_tree_comes_back(tmp_path_factory, tree):
    folder = RunFolder(tmp_path_factory.mktemp("run"))
    folder.save_tree(tree, title="tree")
    assert folder.tree() == tree


def test_a_folder_is_not_overwritten(folder):
    with pytest.raises(UserError, match="is not empty; choose another folder"):
        RunFolder.create(folder.path, CONFIG)
    assert folder.config() == CONFIG


def test_a_file_in_its_place(tmp_path):
    path = tmp_path / "file"
    path.write_text("mine")
    for target in (path, path / "inner"):
        with pytest.raises(UserError, match="choose another"):
            RunFolder.create(target, CONFIG)
    assert path.read_text() == "mine"


def test_what_is_no_run_folder(tmp_path):
    for path in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(UserError, match=r"is not a run folder.*give a folder"):
            RunFolder(path).config()


@pytest.mark.parametrize("content", [b"\xff\xfe\x00", b"Sequence(", b"", b"\0"])
def test_a_damaged_tree_is_named(folder, content):
    path = folder.path / "best_tree.txt"
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"best_tree.txt"):
        folder.tree()
    folder.save_tree(TREE, title="")
    assert folder.tree() == TREE


@pytest.mark.parametrize("content", [b"\xff", b"run,luck\n0,1\n", b"run,generation\nx\n", b"\0"])
def test_a_damaged_history_is_named(folder, content):
    (folder.path / "history.csv").write_bytes(content)
    with pytest.raises(UserError, match=r"history.csv"):
        folder.history()


GP = dataclasses.asdict(GPConfig())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 99}, "has format 99 and this version reads"),
        ({"format": "2"}, "config.json, key format: expected a whole number"),
        ({"gp": {"popul": 3}}, "config.json, key gp.popul: not known here; did you mean population"),
        ({"gp": None}, "config.json, key gp: expected a mapping"),
        (
            {"gp": {"parent_selection": "luck"}},
            "config.json, key gp.parent_selection: expected one of tournament, rank",
        ),
        ({"settings": []}, "config.json, key settings: expected a mapping"),
        ({"baseline": "Sequence("}, r"config.json is damaged \(line 1, column 9"),
        ({"gp": GP | {"population": "16"}}, "config.json, key gp.population: expected a whole number, found '16'"),
        ({"gp": GP | {"elites": 1.5}}, "config.json, key gp.elites: expected"),
        ({"gp": GP | {"p_add": float("nan")}}, "config.json, key gp.p_add: expected a number"),
        ({"gp": GP | {"niches": 1}}, "config.json, key gp.niches: expected true or false"),
        ({"settings": {"draws": "2"}}, "config.json, key settings.draws: expected a whole number"),
        ({"settings": {"level": "deep"}}, "config.json, key settings.level: expected one of physics, kinematic"),
        ({"extra_leaves": None}, "config.json, key extra_leaves: expected a list"),
        ({"extra_leaves": ["Sequence(open_gripper)"]}, "config.json is damaged .* is not a single leaf"),
        ({"baseline": 5}, "config.json, key baseline: expected text or null, found 5"),
        ({"task": {}}, "config.json.* missing; add it"),
        ({"task": None}, "config.json: the task must be a mapping"),
        ({"task": []}, "config.json: the task must be a mapping"),
        (
            {"colour": "red", "version": "9.9"},
            r"config.json was written by version 9.9 and this is .*; use that version",
        ),
    ],
)
def test_a_configuration_that_cannot_be_read(folder, change, words):
    path = folder.path / "config.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(UserError, match=words):
        folder.config()


def test_a_configuration_without_a_task(folder):
    path = folder.path / "config.json"
    path.write_text(json.dumps({key: value for key, value in json.loads(path.read_text()).items() if key != "task"}))
    with pytest.raises(UserError, match=r"config.json, key task: missing"):
        folder.config()


def test_an_older_configuration_without_newer_fields_is_read(folder):
    path = folder.path / "config.json"
    data = json.loads(path.read_text())
    del data["x64"], data["without"], data["gp"]["niches"], data["settings"]["evaluator"]
    path.write_text(json.dumps(data))
    assert folder.config() == CONFIG
    del data["gp"]["method"], data["gp"]["patience"]
    path.write_text(json.dumps(data))
    assert folder.config().gp == dataclasses.replace(CONFIG.gp, method="population")


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "\x00", "[" * 6000, "9" * 5000, "\xff"])
def test_a_configuration_that_is_no_json(folder, text):
    (folder.path / "config.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(UserError, match=r"config.json"):
        folder.config()
