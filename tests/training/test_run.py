"""A run in its folder: what listeners hear, what is written, and what an interruption or a failure leaves behind."""

import contextlib
import dataclasses
import errno
import json
import os
import shutil
import signal

import pytest

from bt_jax._util.errors import UserError
from bt_jax.encoding.formats.text import parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task
from bt_jax.training.history import read_history
from bt_jax.training.progress import Reporter, read_progress
from bt_jax.training.run import TrainingRun
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings
from bt_jax.training.training import evolve

GP = GPConfig(population=8, generations=3, max_nodes=32, runs=2)
SETTINGS = Settings(level="kinematic", layouts=2, test_layouts=4)
CONFIG = RunConfig(load_task("stack"), GP, SETTINGS)


class Recorder:
    """Hears everything, and fails or interrupts where it is told to."""

    def __init__(self, error=None, at=2):
        self.heard, self.error, self.at = [], error, at

    def on_stage(self, stage, message=""):
        self.heard.append((stage, message) if message else stage)

    def on_generation(self, history, best_tree):
        generation = history[-1].generation
        self.heard.append(generation)
        if self.error is not None and generation == self.at:
            error, self.error = self.error, None
            raise error


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A run of three generations, and what was heard of it."""
    folder, recorder = RunFolder(tmp_path_factory.mktemp("runs") / "run"), Recorder()
    run = TrainingRun(folder, CONFIG)
    with run.opened(recorder, Reporter(folder.path, GP.generations)):
        result, session = run.evolve()
        assert not session.stopped
        assert run.draw(result) == ""
    return folder, recorder, result


def test_listeners_hear_every_stage_and_generation(done):
    assert done[1].heard == ["starting", "evolving", 0, 1, 2, 3, "testing", "finished"]


def test_episodes_are_counted_the_same_everywhere(done):
    folder, _, result = done
    data = json.loads((folder.path / "result.json").read_text())
    last = read_history((folder.path / "history.csv").read_text())[-GP.runs :]
    assert data["episodes"] == [row.episodes for row in last] == result.episodes
    assert data["episodes"] == [SETTINGS.layouts * count for count in data["trees_measured"]]
    assert read_progress(folder.path).episodes == sum(data["episodes"])


def test_pictures_are_written_after_everything_else(done):
    folder, *_ = done
    curve, result = (folder.path / name for name in ("learning_curve.png", "result.json"))
    assert curve.read_bytes().startswith(b"\x89PNG")
    assert curve.stat().st_mtime_ns > result.stat().st_mtime_ns


def test_a_result_is_saved_as_a_folder_that_goes_on(done, tmp_path):
    folder, _, result = done
    result.save(tmp_path / "mine")
    for name in ("history.csv", "best_tree.txt", "config.json"):
        assert (tmp_path / "mine" / name).read_bytes() == (folder.path / name).read_bytes(), name
    pictures = [{path.name for path in one.glob("*.png")} for one in (folder.path, tmp_path / "mine")]
    assert pictures[0] == pictures[1] >= {"learning_curve.png"}
    run = TrainingRun(RunFolder(tmp_path / "mine"), RunFolder(tmp_path / "mine").config(), resumed=True)
    with run.opened():
        again, _ = run.evolve()
    assert again.tree == result.tree
    with pytest.raises(UserError, match=r"is not empty; choose another folder$"):
        result.save(tmp_path / "mine")


@pytest.mark.parametrize(
    ("leaves", "problem"),
    [
        (
            lambda known: (*known[:-1], parse_tree("move(GreenBox, (0, 0, 0.3), YellowBox)")),
            "only the checkpoint has .*0.3",
        ),
        (lambda known: (*known[:-2], known[-1], known[-2]), "another order"),
        (
            lambda known: (*known[:-1], parse_tree("move(RedBox, (0, 0, 0.1), YellowBox)")),
            "only the checkpoint has .*RedBox",
        ),
    ],
)
def test_a_checkpoint_with_other_behaviors_is_refused_and_nothing_changes(done, tmp_path, leaves, problem):
    folder = RunFolder(tmp_path / "run")
    shutil.copytree(done[0].path, folder.path)
    saved = folder.load_checkpoint()
    folder.save_checkpoint(dataclasses.replace(saved, symbols=leaves(saved.symbols)))
    before = {path.name: path.read_bytes() for path in folder.path.iterdir()}
    with pytest.raises(UserError, match=f"are not of one run: .*{problem}"):
        TrainingRun(folder, folder.config(), resumed=True)
    assert {path.name: path.read_bytes() for path in folder.path.iterdir()} == before


def test_no_folder_is_made_for_a_task_that_cannot_be_simulated(tmp_path):
    pills = tuple(dataclasses.replace(box, size=(0.0003,) * 3) for box in CONFIG.task.objects)
    task = dataclasses.replace(CONFIG.task, objects=pills)
    config = dataclasses.replace(CONFIG, task=task, settings=Settings(backend="mujoco"))
    with pytest.raises(UserError, match=r"MuJoCo cannot simulate the task stack .*mjMINVAL.*; change the sizes"):
        TrainingRun(RunFolder(tmp_path / "run"), config)
    assert not list(tmp_path.iterdir())


def test_evolve_gives_what_a_run_in_a_folder_gives(done):
    result = evolve(CONFIG.task, GP, SETTINGS)
    assert (result.trees, result.episodes) == (done[2].trees, done[2].episodes)


def test_an_interruption_keeps_the_last_generation(tmp_path):
    folder, recorder = RunFolder(tmp_path / "run"), Recorder(KeyboardInterrupt(), at=1)
    run = TrainingRun(folder, CONFIG)
    with run.opened(recorder):
        result, session = run.evolve()
    assert (session.stopped, result.generations) == (True, 1)
    assert recorder.heard == ["starting", "evolving", 0, 1, 1, "testing", "stopped"]
    assert folder.load_checkpoint().state.generation == 1


def test_signals_that_follow_at_once_lose_nothing(tmp_path):
    class Impatient(Recorder):
        def on_generation(self, history, best_tree):
            super().on_generation(history, best_tree)
            if history[-1].generation == 1:
                try:
                    os.kill(os.getpid(), signal.SIGINT)
                finally:
                    os.kill(os.getpid(), signal.SIGINT)

    folder, impatient = RunFolder(tmp_path / "run"), Impatient()
    run = TrainingRun(folder, CONFIG)
    with run.opened(impatient):
        result, session = run.evolve()
    assert (session.stopped, result.generations, impatient.heard[-1]) == (True, 1, "stopped")
    assert folder.tree() == result.tree
    assert (folder.path / "result.json").is_file()
    assert folder.load_checkpoint().state.generation == 1


@pytest.mark.parametrize(
    ("error", "stage", "message"),
    [(UserError("fix it"), "failed", "fix it"), (ValueError("odd"), "failed", "ValueError: odd")],
)
def test_a_failure_is_told(tmp_path, error, stage, message):
    recorder, run = Recorder(), TrainingRun(RunFolder(tmp_path / "run"), CONFIG)
    with pytest.raises(type(error)), run.opened(recorder):
        raise error
    assert recorder.heard[-1] == (stage, message)


@pytest.mark.parametrize("error", [OSError("the terminal has gone"), SystemExit(1)])
def test_a_run_goes_on_without_a_listener_that_raises(tmp_path, capsys, error):
    broken, recorder = Recorder(error, at=1), Recorder()
    run = TrainingRun(RunFolder(tmp_path / "run"), CONFIG)
    with run.opened(broken, recorder):
        result, session = run.evolve()
    assert (session.stopped, result.generations) == (False, 3)
    assert broken.heard == ["starting", "evolving", 0, 1]
    assert recorder.heard == ["starting", "evolving", 0, 1, 2, 3, "testing", "finished"]
    assert capsys.readouterr().err.count("warning: Recorder") == 1


class Disk:
    """Is full from one generation on, and maybe free again from another."""

    def __init__(self, full, free=10**6):
        self.full, self.free, self.now = full, free, -1

    def on_stage(self, stage, message=""):
        pass

    def on_generation(self, history, best_tree):
        self.now = history[-1].generation

    def fsync(self, file):
        if self.full <= self.now < self.free:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("free", [2, 10**6])
def test_an_evolution_goes_on_where_nothing_more_can_be_written(tmp_path, monkeypatch, capsys, done, free):
    disk, run = Disk(1, free), TrainingRun(RunFolder(tmp_path / "run"), CONFIG)
    monkeypatch.setattr("bt_jax.training.run.CHECKPOINT_SECONDS", 0.0)
    monkeypatch.setattr("bt_jax.training.run.CHECKPOINT_SHARE", 0)
    monkeypatch.setattr(os, "fsync", disk.fsync)
    with run.opened(disk):
        result, _ = run.evolve()
        assert run.draw(result) == ""
    assert result.trees == done[2].trees
    said = capsys.readouterr().err
    assert said.startswith(
        f"warning: {tmp_path / 'run' / 'checkpoint.npz'} cannot be written (No space left on device)"
    )
    assert said.count("\n") == 1
    full = free > 3
    assert ("No space left" in run.unwritten) == full
    assert run.folder.load_checkpoint().state.generation == (1 if full else 3)
    assert (run.folder.path / "result.json").is_file() != full


def test_a_complete_run_has_finished_whatever_happens_then(tmp_path):
    recorder, run = Recorder(), TrainingRun(RunFolder(tmp_path / "run"), CONFIG)
    with contextlib.suppress(OSError), run.opened(recorder):
        run.evolve()
        raise OSError("the terminal has gone")
    assert recorder.heard[-1] == "finished"


def test_a_picture_that_fails_costs_only_the_picture(done, monkeypatch):
    folder, _, result = done
    run = TrainingRun(folder, CONFIG, resumed=True)
    monkeypatch.setattr("bt_jax.training.plots.learning_curve", lambda *_, **__: 1 / 0)
    assert "results are complete" in run.draw(result)
