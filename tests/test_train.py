"""The command line, as a user meets it: in a process of its own where it matters, in this one where it only refuses."""

import dataclasses
import json
import random
import signal
import subprocess
import sys
import time

import jax
import numpy as np
import pytest

from bt_jax import demonstrate, run
from bt_jax.commands.arguments import parse_train
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.encoding.formats.xml_reader import from_xml
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.train import main
from bt_jax.training.progress import read_progress
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from tests.helpers.samples import train, train_command

QUICK = ("stack", "--level", "kinematic", "--population", 8, "--max-nodes", 32, "--test-layouts", 10, "--device", "cpu")
SAME_BYTES = ("history.csv", "best_tree.txt", "best_tree.xml", "best_tree.svg")


def refused(monkeypatch, capsys, *arguments):
    """The one sentence that the command says before it ends with code 2."""
    monkeypatch.setattr(sys, "argv", ["train", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 2
    said = capsys.readouterr()
    assert said.err.startswith("error: ")
    assert said.err.count("\n") == 1
    assert "Traceback" not in said.err
    return said.err


def train_folder(path, *arguments):
    done = train(*QUICK, "--out", path, *arguments)
    assert done.returncode == 0, done.stderr
    return done


@pytest.mark.parametrize(
    ("arguments", "remedy"),
    [
        (("shelf",), "choose one of"),
        (("stack", "--task", "mine.yaml"), "name one"),
        (("--task", "nowhere.yaml"), "check the path"),
        (("--population", 3), "choose 8 to 100000"),
        (("--p-add", 0.5), "make them sum to 1"),
        (("--p-add", -0.1, "--p-delete", 0.7), "from 0 to 1"),
        (("--generations", 0), "choose 1 or more"),
        (("--runs", 0), "choose 1 or more"),
        (("--layouts", 0), "choose 1 or more"),
        (("--seed", -1), "choose 0 or more"),
        (("--max-nodes", 300), "max_nodes"),
        (("--time-limit", -3), "choose seconds above 0"),
        (("--time-limit", "nan"), "choose seconds above 0"),
        (("--target-fitness", "nan"), "choose a number"),
        (("--baseline", "nowhere.txt"), "give a run folder, or a tree"),
        (
            ("--niches",),
            "niches is a setting of the method population, and the method is achievements; choose --method pop",
        ),
        (("--published", "--patience", 5), "choose --method achievements"),
        (("--resume", "nowhere"), "give a folder"),
    ],
)
def test_what_cannot_be_done_is_said_in_one_sentence(monkeypatch, capsys, tmp_path, arguments, remedy):
    monkeypatch.chdir(tmp_path)
    assert remedy in refused(monkeypatch, capsys, *arguments)
    assert list(tmp_path.iterdir()) == []


def test_an_invalid_task_file(monkeypatch, capsys, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("extends: stack\ntargets: [{object: RedBox, position: [0, 0, 0.1], frame: KittingBox}]\n")
    said = refused(monkeypatch, capsys, "--task", path)
    for words in ("mine.yaml", "targets[0].object", "RedBox", "use one of YellowBox"):
        assert words in said


@pytest.mark.parametrize(
    ("name", "content"),
    [("tree.txt", "Sequence("), ("tree.xml", "<root"), ("tree.txt", b"\xff\xfe\xff"), ("tree.xml", "")],
)
def test_a_baseline_that_is_no_tree(monkeypatch, capsys, tmp_path, name, content):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    refused(monkeypatch, capsys, "stack", "--baseline", path, "--out", tmp_path / "run")


def test_a_baseline_of_another_task(monkeypatch, capsys, tmp_path):
    path = tmp_path / "tree.txt"
    path.write_text("pick(RedBox)\n")
    said = refused(monkeypatch, capsys, "stack", "--level", "kinematic", "--baseline", path, "--out", tmp_path / "run")
    assert said.startswith(f"error: {path}: pick(RedBox): task stack has no object 'RedBox'; use one of YellowBox")


@pytest.mark.parametrize(
    "words", [(run, []), (demonstrate, ["pick BlueBox; to (0, 0, 0.12) GreenBox; release", "--after"])]
)
def test_a_tree_of_another_task_is_named_by_every_command(capsys, tmp_path, words):
    path = tmp_path / "tree.txt"
    path.write_text("pick(RedBox)\n")
    command, arguments = words
    with pytest.raises(SystemExit) as end:
        command.main([*([str(tmp_path / "demos")] if arguments else []), *arguments, str(path)])
    assert end.value.code == 2
    assert capsys.readouterr().err.startswith(f"error: {path}: pick(RedBox): task stack")
    assert list(tmp_path.iterdir()) == [path]


def test_where_nothing_can_be_written(monkeypatch, capsys, tmp_path):
    path = tmp_path / "file"
    path.write_text("mine")
    assert "choose another" in refused(monkeypatch, capsys, "stack", "--out", path / "run")
    assert "is a file; choose another --out" in refused(monkeypatch, capsys, "stack", "--out", path)
    assert "--resume" not in refused(monkeypatch, capsys, "stack", "--out", tmp_path)
    RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(), Settings()))
    assert "--resume" in refused(monkeypatch, capsys, "stack", "--out", tmp_path / "run")


@pytest.mark.parametrize("option", ["--out", "--resume", "--baseline", "--add-target-from", "--add-subgoal-from"])
def test_a_path_that_no_file_can_have(monkeypatch, capsys, tmp_path, option):
    monkeypatch.chdir(tmp_path)
    assert "x" * 300 in refused(monkeypatch, capsys, option, "x" * 300)
    assert list(tmp_path.iterdir()) == []


def test_numbers_that_are_chosen_by_the_population_are_called_auto(monkeypatch, capsys, tmp_path):
    RunFolder.create(
        tmp_path / "run", RunConfig(load_task("stack"), GPConfig(method="population", elites=3), Settings())
    )
    assert parse_train(["--elites", "auto"]).gp == GPConfig()
    assert parse_train(["--resume", str(tmp_path / "run")]).gp.elites == 3
    assert "give only" in refused(monkeypatch, capsys, "--resume", tmp_path / "run", "--elites", "auto")


def test_a_run_of_another_version(monkeypatch, capsys, tmp_path):
    folder = RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(), Settings()))
    config = folder.path / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | {"format": 0}))
    assert "use the version that wrote it" in refused(monkeypatch, capsys, "--resume", folder.path)


def test_resuming_keeps_the_settings(monkeypatch, capsys, tmp_path):
    RunFolder.create(tmp_path / "run", RunConfig(load_task("stack"), GPConfig(), Settings()))
    for extra in (("--population", 32), ("--layouts", 2), ("stack",)):
        assert "give only" in refused(monkeypatch, capsys, "--resume", tmp_path / "run", *extra)


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="there is a GPU")
def test_a_gpu_that_is_not_there(tmp_path):
    done = train("stack", "--device", "gpu", "--out", tmp_path / "run")
    assert done.returncode == 2
    assert "use --device cpu" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """What a run of 6 generations has said, and its folder."""
    folder = tmp_path_factory.mktemp("runs") / "whole"
    return train_folder(folder, "--generations", 6), folder


def test_a_run_leaves_its_folder(whole):
    done, path = whole
    assert "learnt tree" in done.stdout
    assert done.stderr == ""
    folder = RunFolder(path)
    rows = (path / "history.csv").read_text().splitlines()
    assert len(rows) == 1 + 7
    result = json.loads((path / "result.json").read_text())
    assert result["fitness"] == max(run["fitness"] for run in result["runs"])
    assert folder.tree() == from_xml((path / "best_tree.xml").read_text())
    assert folder.tree() in [parse_tree(run["tree"]) for run in result["runs"]]
    assert folder.config().gp == GPConfig(population=8, generations=6, max_nodes=32)
    assert not [file.name for file in path.iterdir() if file.name.startswith(".")]


def test_more_generations_continue_a_finished_run(tmp_path, whole):
    train_folder(tmp_path / "parts", "--generations", 3)
    done = train("--resume", tmp_path / "parts", "--generations", 6, "--device", "cpu")
    assert done.returncode == 0, done.stderr
    same_results(tmp_path / "parts", whole[1])


def test_fewer_generations_than_a_run_has_are_refused_and_change_nothing(monkeypatch, capsys, whole):
    config = whole[1] / "config.json"
    before = config.read_text()
    for generations in (3, 5):
        said = refused(monkeypatch, capsys, "--resume", whole[1], "--generations", generations)
        assert f"is at generation 6 and {generations} are asked for; give --generations more than 6" in said
    assert config.read_text() == before


def same_results(a, b):
    for name in SAME_BYTES:
        assert (a / name).read_bytes() == (b / name).read_bytes(), name
    ours, theirs = (np.load(folder / "checkpoint.npz") for folder in (a, b))
    assert ours.files == theirs.files
    for name in ours.files:
        np.testing.assert_array_equal(ours[name], theirs[name])
    ours, theirs = (json.loads((folder / "result.json").read_text()) for folder in (a, b))
    varies = {"last_session"}
    assert {k: v for k, v in ours.items() if k not in varies} == {k: v for k, v in theirs.items() if k not in varies}


def start(folder, *arguments):
    return subprocess.Popen(
        train_command(*QUICK, "--out", folder, *arguments), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def stopped(folder, how, *, wait):
    """Starts an endless training and sends it a signal `wait` seconds after its first checkpoint."""
    process = start(folder, "--generations", 1_000_000)
    try:
        while not (folder / "checkpoint.npz").exists():
            assert process.poll() is None, process.communicate()
            time.sleep(0.05)
        time.sleep(wait)
        process.send_signal(how)
        out, err = process.communicate(timeout=120)
    finally:
        process.kill()
    return process.returncode, out, err


def killed_and_resumed(tmp_path, kills):
    folder, rng = tmp_path / "stopped", random.Random(0)
    code, _, _ = stopped(folder, signal.SIGKILL, wait=rng.random())
    assert code == -signal.SIGKILL
    for _ in range(kills - 1):
        process = subprocess.Popen(train_command("--resume", folder, "--device", "cpu"), stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(3, 8))
        process.kill()
        process.wait()
    generations = RunFolder(folder).load_checkpoint().state.generation + 30
    done = train("--resume", folder, "--generations", generations, "--device", "cpu")
    assert done.returncode == 0, done.stderr
    train_folder(tmp_path / "whole", "--generations", generations)
    same_results(folder, tmp_path / "whole")


@pytest.mark.slow
def test_a_run_killed_twice_goes_on_as_if_nothing_had_happened(tmp_path):
    killed_and_resumed(tmp_path, kills=2)


@pytest.mark.parametrize("how", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow)])
def test_an_interrupted_run_keeps_its_tree_and_says_how_to_go_on(tmp_path, how):
    folder = tmp_path / "stopped"
    code, out, err = stopped(folder, how, wait=0.3)
    assert code == 0, err
    assert "Traceback" not in err
    assert "--resume" in out
    tree, result = RunFolder(folder).tree(), json.loads((folder / "result.json").read_text())
    assert parse_tree(result["runs"][0]["tree"]) == tree
    rows = (folder / "history.csv").read_text().splitlines()
    checkpoint = RunFolder(folder).load_checkpoint()
    state, history = checkpoint.state, checkpoint.history
    assert result["generations"] == state.generation == len(rows) - 2 == history[-1].generation
    assert dataclasses.replace(RunFolder(folder).config().gp, generations=None) == GPConfig(population=8, max_nodes=32)


def test_a_run_that_nobody_reads_any_more_is_completed(tmp_path):
    process = start(tmp_path / "run", "--generations", 20, "--progress")
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(timeout=120) == 0
    assert process.stderr.read() == "warning: nobody reads what this prints any more; the command goes on\n"
    process.stderr.close()
    assert read_progress(tmp_path / "run").stage == "finished"
    assert json.loads((tmp_path / "run" / "result.json").read_text())["generations"] == 20
    assert (tmp_path / "run" / "learning_curve.png").is_file()


LIMITED = """
import resource, sys
from bt_jax.train import main
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, 5000))  # more than config.json, less than a checkpoint
main(sys.argv[1:])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such limit")
def test_a_run_whose_results_cannot_be_kept_shows_them_and_fails(tmp_path):
    words = [*map(str, (*QUICK, "--generations", 6, "--out", tmp_path / "run"))]
    done = subprocess.run([sys.executable, "-c", LIMITED, *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "learnt tree" in done.stdout
    assert "success " in done.stdout
    *_, last = done.stderr.splitlines()
    assert last.startswith(f"error: the results, shown above, are not all in {tmp_path / 'run'}: ")
    assert "checkpoint.npz cannot be written (File too large); free some space" in last
    assert "Traceback" not in done.stderr
    assert RunFolder(tmp_path / "run").tree()


def test_an_interruption_before_the_first_generation(tmp_path):
    process = start(tmp_path / "run")
    while not (tmp_path / "run" / "config.json").exists():
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=120)
    assert "Traceback" not in err
    assert process.returncode in (0, 2, 130)


def test_an_implausible_task_leaves_no_folder(monkeypatch, capsys, tmp_path):
    source = tmp_path / "pills.yaml"
    source.write_text("extends: stack\nname: pills\nboxes: [{name: YellowBox, size: 0.0003, color: [1, 0, 0]}]\n")
    said = refused(monkeypatch, capsys, "--task", source, "--out", tmp_path / "run")
    assert "key boxes[0].size: 0.0003 is implausible; write 0.005 to 2 m" in said
    source.write_text("extends: stack\nname: sub\nsubgoals: [{name: tidy, conditions: [clear(PinkBox)]}]\n")
    said = refused(monkeypatch, capsys, "--task", source, "--out", tmp_path / "run")
    assert f"{source}, key subgoals[0].conditions[0]: clear(PinkBox): task sub has no object 'PinkBox'" in said
    assert not (tmp_path / "run").exists()
