import dataclasses
import json

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bt_jax._util.errors import UserError
from bt_jax.behaviors import gene_pool
from bt_jax.encoding.arrays import Trees
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml import from_xml
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
floats = st.floats(-1e6, 1e6)
rows = st.builds(
    Generation,
    **{f.name: st.integers(0, 10**6) if f.type == "int" else floats for f in dataclasses.fields(Generation)},
)


def state(runs=2):
    rng = np.random.default_rng(0)
    tokens = rng.integers(0, 60, (runs, 8, 16)).astype(np.int16)
    trees = Trees(jax.numpy.asarray(tokens), jax.numpy.ones((runs, 8, 16), jax.numpy.uint8))
    fitness = jax.numpy.asarray(rng.normal(size=(runs, 8)).astype(np.float32))
    seen = tuple(np.sort(rng.integers(0, 2**63, 5 + r).astype(np.uint64)) for r in range(runs))
    return State(Population(trees, fitness), 7, fitness[:, 0], seen, tuple(range(3, 3 + runs)))


@pytest.fixture
def folder(tmp_path):
    return RunFolder.create(tmp_path / "run", CONFIG)


@pytest.mark.parametrize("name", task_names())
def test_the_configuration_is_read_back(tmp_path, name):
    config = RunConfig(
        load_task(name),
        GPConfig(population=20, parent_selection=Selection.RANK, baseline_index=1, elites=3),
        Settings(level="kinematic", layouts=3),
        TREE,
        extra_leaves=(parse_tree("subtask(aside, Sequence(move(BlueBox, (0, 0, 0.3), KittingBox), open_gripper))"),),
        phase=2,
        since=50,
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
def test_the_checkpoint_is_read_back(folder, runs):
    assert folder.load_checkpoint() is None
    saved, history = state(runs), [Generation(0, 7, 8, -1.5, -2.0, 0.5, 3, 0.25, 1.0, 1, 2)]
    leaves = CONFIG.extra_leaves + gene_pool(CONFIG.task).leaves
    folder.save_checkpoint(Checkpoint(saved, leaves, 3, history))
    checkpoint = folder.load_checkpoint()
    found = checkpoint.state
    assert (checkpoint.history, checkpoint.leaves, checkpoint.phase) == (history, leaves, 3)
    assert found.generation == 7
    assert_same(
        (found.population, found.baseline_fitness, found.seen), (saved.population, saved.baseline_fitness, saved.seen)
    )
    assert found.trees_measured == saved.trees_measured


@pytest.mark.parametrize("damage", ["empty", "half", "flipped", "text"])
def test_a_damaged_checkpoint_is_named(folder, damage):
    folder.save_checkpoint(Checkpoint(state(), (), 0, []))
    path = folder.path / "checkpoint.npz"
    data = path.read_bytes()
    middle = len(data) // 2
    flipped = data[:middle] + bytes(255 - b for b in data[middle : middle + 50]) + data[middle + 50 :]
    path.write_bytes({"empty": b"", "half": data[:middle], "flipped": flipped, "text": b"hello\n" * 100}[damage])
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        folder.load_checkpoint()


@pytest.mark.parametrize(
    "change",
    [
        {"history": np.frombuffer(b"run,generation\n0,1\n", np.uint8)},
        {"history": np.frombuffer(b"run,luck\n0,1\n", np.uint8)},
        {"generation": np.array([1, 2])},
        {"leaves": np.frombuffer(b"pick(", np.uint8)},
    ],
)
def test_a_checkpoint_with_wrong_content_is_named(folder, change):
    folder.save_checkpoint(Checkpoint(state(), (), 0, []))
    path = folder.path / "checkpoint.npz"
    with np.load(path) as data:
        arrays = {**data, **change}
    np.savez(path, **arrays)
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        folder.load_checkpoint()


def test_a_checkpoint_of_a_strange_zip_version_is_named(folder):
    folder.save_checkpoint(Checkpoint(state(), (), 0, []))
    path = folder.path / "checkpoint.npz"
    data = bytearray(path.read_bytes())
    data[data.index(b"PK\x01\x02") + 6] = 92  # the version that the first entry needs
    path.write_bytes(data)
    with pytest.raises(UserError, match=r"checkpoint.npz is damaged; delete it"):
        folder.load_checkpoint()


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


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"format": 99}, "has format 99 and this version reads"),
        ({"gp": {"popul": 3}}, "is damaged"),
        ({"gp": None}, "is damaged"),
        ({"gp": {"parent_selection": "luck"}}, "is damaged"),
        ({"settings": []}, "is damaged"),
        ({"baseline": "Sequence("}, r"config.json is damaged \(line 1, column 9"),
        ({"gp": dataclasses.asdict(GPConfig()) | {"population": "x"}}, "is damaged .population is 'x'"),
        ({"gp": dataclasses.asdict(GPConfig()) | {"elites": 1.5}}, "is damaged .elites is 1.5"),
        ({"settings": {"layouts": "2"}}, "is damaged .layouts is '2'"),
        ({"settings": {"level": "deep"}}, "is damaged .level is 'deep'"),
        ({"extra_leaves": None}, "is damaged"),
        ({"baseline": 5}, "is damaged"),
        ({"task": {}}, "missing; add it"),
        ({"task": None}, "config.json: the task must be a mapping"),
        ({"task": []}, "config.json: the task must be a mapping"),
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
    with pytest.raises(UserError, match=r"config.json is damaged \(no 'task'\)"):
        folder.config()


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "\x00"])
def test_a_configuration_that_is_no_json(folder, text):
    (folder.path / "config.json").write_text(text)
    with pytest.raises(UserError, match=r"config.json cannot be read"):
        folder.config()
