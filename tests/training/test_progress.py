"""Progress as another process reads it, and the lock that tells whether its writer lives."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time

import pytest

from bt_jax._util.errors import UserError
from bt_jax.behaviors import Behavior
from bt_jax.encoding.formats.text import one_line
from bt_jax.gp.evolution import Generation
from bt_jax.training.history import read_history
from bt_jax.training.progress import Progress, Reporter, is_alive, locked, read_progress
from bt_jax.training.run_folder import RunFolder
from tests.helpers.samples import train, train_command

QUICK = ("stack", "--level", "kinematic", "--population", 8, "--max-nodes", 32, "--test-layouts", 10, "--device", "cpu")
HOLD = """
import pathlib, sys
from bt_jax.training.progress import locked
with locked(pathlib.Path(sys.argv[1])):
    print(flush=True)
    sys.stdin.read()
"""


def row(generation, best, mean, run=0):
    return Generation(run, generation, 10 * generation, best, mean, 1.0, 3, 0.5, 2.0, 0, -1)


def until(condition, seconds=120):
    """Waits until something holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it never came to that"
        time.sleep(0.02)


@pytest.fixture
def holder(tmp_path):
    """A process that trains in `tmp_path`."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    process.stdout.readline()
    yield process
    process.kill()
    process.communicate()


def pick() -> Behavior:
    return Behavior("pick", ("YellowBox",))


def test_what_is_written_is_read(tmp_path):
    reporter = Reporter(tmp_path, 50)
    reporter.on_stage("starting")
    assert read_progress(tmp_path) == Progress(os.getpid(), "starting", generations=50)
    history = [
        row(0, -90.0, -200.5),
        row(0, -80.0, -100.5, run=1),
        row(1, -30.0, -50.0),
        row(1, -40.0, -60.0, run=1),
    ]
    reporter.on_stage("evolving")
    reporter.on_generation(history, pick)
    found = read_progress(tmp_path)
    assert found.history == ((0, -80.0, -150.5), (1, -30.0, -55.0))
    assert (found.stage, found.generation, found.best, found.mean) == ("evolving", 1, -30.0, -55.0)
    assert (found.tree, found.episodes) == ("pick(YellowBox)", 20)
    reporter.on_stage("finished")
    assert read_progress(tmp_path) == dataclasses.replace(found, stage="finished", generations=found.generation)


def test_of_a_long_history_some_rows_are_kept():
    rows = [row(generation, -float(generation), -1.0, run=run) for generation in range(12_345) for run in range(3)]
    kept = Progress(1).with_history(rows).history
    assert len(kept) == 500
    assert (kept[0][0], kept[-1][0]) == (0, 12_344)
    assert all(best == -generation for generation, best, _ in kept)
    assert len({generation for generation, *_ in kept}) == 500


def test_it_is_written_five_times_a_second_at_most(tmp_path, monkeypatch):
    now = [100.0]
    monkeypatch.setattr("bt_jax.training.progress.time.monotonic", lambda: now[0])
    reporter = Reporter(tmp_path, 50)
    reporter.on_stage("evolving")
    for generation, seconds in enumerate([0.0, 0.1, 0.05, 0.1, 0.0]):
        now[0] += seconds
        reporter.on_generation([row(generation, -1.0, -2.0)], pick)
        assert read_progress(tmp_path).generation == [0, 0, 0, 3, 3][generation]
    reporter.on_stage("testing")
    assert read_progress(tmp_path).generation == 4


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "{}",
        '{"pid": "1"}',
        "[" * 6000,
        '{"pid": 1, "tree": "pick("}',
        '{"pid": 1, "history": 3}',
        '{"future": 1, "history": []}',
    ],
)
def test_what_cannot_be_read_is_none(tmp_path, text):
    assert read_progress(tmp_path) is None
    (tmp_path / "progress.json").write_text(text)
    assert read_progress(tmp_path) is None


def test_a_writer_lives_until_its_process_ends(tmp_path, holder):
    assert is_alive(tmp_path)
    holder.send_signal(signal.SIGSTOP)
    assert is_alive(tmp_path)
    holder.kill()
    holder.wait()
    assert not is_alive(tmp_path)
    assert not is_alive(tmp_path / "nowhere")


def test_two_processes_do_not_train_in_one_folder(tmp_path, holder):
    with pytest.raises(UserError, match="another process"), locked(tmp_path):
        pytest.fail("it has begun")
    holder.kill()
    holder.wait()
    with locked(tmp_path):
        assert is_alive(tmp_path)
    assert not is_alive(tmp_path)


def test_what_was_reported_before_is_kept_until_there_is_news(tmp_path):
    reporter = Reporter(tmp_path, 50)
    reporter.on_generation([row(0, -90.0, -200.5), row(1, -30.0, -50.0)], pick)
    reporter.on_stage("finished")
    before, later = read_progress(tmp_path), Reporter(tmp_path, 60)
    later.on_stage("starting")
    assert read_progress(tmp_path) == dataclasses.replace(before, stage="starting", generations=60)
    later.on_stage("failed", "fix it")
    assert read_progress(tmp_path) == dataclasses.replace(before, stage="failed", generations=60, message="fix it")


def test_a_report_that_cannot_be_written_ends_no_training(tmp_path):
    (tmp_path / "file").write_text("in the way")
    reporter = Reporter(tmp_path / "file", 50)
    reporter.on_generation([row(1, -1.0, -2.0)], pick)
    reporter.on_stage("finished")
    assert (tmp_path / "file").read_text() == "in the way"


def test_a_training_reports_what_it_writes_at_the_end(tmp_path):
    done = train(*QUICK, "--generations", 5, "--out", tmp_path / "run", "--progress")
    assert done.returncode == 0, done.stderr
    found, rows = read_progress(tmp_path / "run"), read_history((tmp_path / "run" / "history.csv").read_text())
    assert (found.stage, found.generation, found.generations) == ("finished", 5, 5)
    assert [row[0] for row in found.history] == list(range(6))
    assert [row[1] for row in found.history] == pytest.approx([row.best for row in rows], abs=0.006)
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert found.tree == result["runs"][0]["tree"]
    assert [found.episodes] == [rows[-1].episodes] == result["episodes"] == result["trees_measured"]
    assert not is_alive(tmp_path / "run")


def test_an_interrupted_training_reports_that_however_often_it_is_interrupted(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(train_command(*QUICK, "--generations", 100_000, "--out", folder, "--progress"))
    try:
        until(lambda: (found := read_progress(folder)) is not None and found.generation >= 2)
        assert is_alive(folder)
        process.send_signal(signal.SIGINT)
        until(lambda: read_progress(folder).stage == "testing")
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=120) in (0, 130)
    finally:
        process.kill()
    found = read_progress(folder)
    assert found.stage == "stopped"
    assert found.generation == found.history[-1][0] >= 2
    assert RunFolder(folder).load_checkpoint().state.generation == found.generation
    assert one_line(RunFolder(folder).tree()) == found.tree
    assert not is_alive(folder)


@pytest.mark.slow
def test_a_folder_that_is_removed_meanwhile_is_made_anew(tmp_path):
    folder = tmp_path / "run"
    process = subprocess.Popen(train_command(*QUICK, "--generations", 100_000, "--out", folder, "--progress"))
    try:
        until(lambda: (found := read_progress(folder)) is not None and found.generation >= 2)
        folder.rename(tmp_path / "elsewhere")
        until(lambda: (folder / "checkpoint.npz").is_file())
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=120) == 0
    finally:
        process.kill()
    assert RunFolder(folder).config().task.name == "stack"
    assert read_progress(folder).stage == "stopped"
    assert (folder / "result.json").is_file()
