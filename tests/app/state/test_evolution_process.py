"""The evolution as the page handles it: with the real process, and with what such a process has left behind."""

import asyncio
import dataclasses
import os
import signal
import time

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.state.evolution_process import EvolutionProcess
from bt_jax.app.state.studio import Studio
from bt_jax.app.state.workspace import Workspace
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.gp.config import GPConfig
from bt_jax.gp.evolution import Generation
from bt_jax.tasks import load_task
from bt_jax.training.phases import Changes
from bt_jax.training.progress import Reporter, locked, read_progress
from bt_jax.training.run_config import RunConfig
from bt_jax.training.run_folder import RunFolder
from bt_jax.training.settings import Settings

STACK = load_task("stack")
LONG = GPConfig(population=8, generations=100_000, max_nodes=32)
TREE = "Sequence(pick(YellowBox), place(YellowBox, (0, 0, 0.052), KittingBox))"


def until(evolution, *stages, seconds=240):
    """Polls until one of the stages is reached."""
    end = time.monotonic() + seconds
    while evolution.stage not in stages:
        assert time.monotonic() < end, f"{evolution.stage}, not {stages}: {evolution.sentence}"
        evolution.poll()
        time.sleep(0.02)


def advances(evolution, seconds=240):
    """Whether another generation is reported."""
    before, end = evolution.progress.generation, time.monotonic() + seconds
    while evolution.progress.generation == before:
        assert time.monotonic() < end, "it does not go on"
        evolution.poll()
        time.sleep(0.02)


@pytest.fixture
def evolution(tmp_path):
    evolution = EvolutionProcess(Workspace(tmp_path))
    yield evolution
    evolution.close()
    if evolution.progress is not None and evolution.running:
        os.kill(evolution.progress.pid, signal.SIGKILL)


def left_behind(workspace, name="old", *, stage="evolving"):
    """A run folder whose process has ended in a stage."""
    folder = RunFolder.create(workspace.runs / name, RunConfig(STACK, GPConfig(), Settings()))
    folder.save_tree(parse_tree(TREE), title="old")
    with locked(folder.path):
        reporter = Reporter(folder.path, 50)
        reporter.on_generation([Generation(0, 3, 30, -90.0, -200.0, 1.0, 3, 0.5, 2.0, 0, -1)], lambda: parse_tree(TREE))
        reporter.on_stage(stage)
    return folder


def test_a_person_starts_pauses_resumes_and_stops(evolution):
    evolution.start(STACK, LONG)
    assert evolution.stage == "starting"
    with pytest.raises(UserError, match="stop it first"):
        evolution.start(STACK, LONG)
    until(evolution, "evolving")
    advances(evolution)
    assert evolution.tree is not None

    evolution.pause()
    evolution.poll()
    assert evolution.stage == "paused"
    halted = read_progress(evolution.workspace.runs / evolution.run).generation
    with pytest.raises(UserError, match="is running"):
        evolution.go_on(10)

    evolution.resume()
    evolution.poll()
    assert evolution.stage == "evolving"
    advances(evolution)
    assert evolution.progress.generation > halted

    evolution.pause()
    evolution.stop()
    evolution.poll()
    assert evolution.stage in ("stopping", "testing")
    until(evolution, "stopped")
    assert evolution.result["generations"] == evolution.progress.generation
    assert one_line(evolution.tree) == evolution.progress.tree
    for request in (evolution.pause, evolution.resume, evolution.stop):
        with pytest.raises(UserError):
            request()

    reached = evolution.progress.generation
    evolution.go_on(3)
    until(evolution, "finished")
    assert evolution.progress.generation == reached + 3
    assert [row[0] for row in evolution.progress.history] == list(range(reached + 4))


@pytest.mark.slow
def test_a_killed_process_is_told_and_goes_on_from_its_checkpoint(evolution):
    evolution.start(STACK, LONG)
    until(evolution, "evolving")
    folder = RunFolder(evolution.workspace.runs / evolution.run)
    end = time.monotonic() + 240
    while (checkpoint := folder.load_checkpoint()) is None or not checkpoint.state.generation:
        assert time.monotonic() < end
        time.sleep(0.05)
    os.kill(evolution.progress.pid, signal.SIGKILL)
    until(evolution, "killed")
    assert "go on" in evolution.sentence
    kept = folder.load_checkpoint().state.generation
    evolution.progress = dataclasses.replace(evolution.progress, generation=kept - 1)  # as if killed earlier
    evolution.go_on(1)
    until(evolution, "evolving", "testing", "finished")
    assert evolution.progress.generation >= kept


@pytest.mark.slow
def test_another_page_finds_the_evolution(evolution):
    evolution.start(STACK, LONG)
    until(evolution, "evolving")
    advances(evolution)
    evolution.pause()
    evolution.poll()
    other = Studio(evolution.workspace, load_task("pyramid"))
    other.restore()
    assert (other.evolution.run, other.evolution.stage, other.edited.task) == (evolution.run, "paused", STACK)
    assert other.playing.tree == other.evolution.tree == evolution.tree
    other.evolution.resume()
    advances(other.evolution)
    other.evolution.stop()
    until(other.evolution, "stopped")
    until(evolution, "stopped")


def test_stopped_before_the_first_generation(evolution):
    evolution.start(STACK, LONG)
    evolution.stop()
    until(evolution, "stopped")
    assert "nothing was learnt" in evolution.sentence


@pytest.mark.slow
def test_a_worker_trains_what_it_is_told_though_prepared_for_another(evolution):
    evolution.prepare(load_task("restack"))
    evolution.start(STACK, dataclasses.replace(LONG, generations=2, seed=3))
    until(evolution, "finished")
    config = RunFolder(evolution.workspace.runs / evolution.run).config()
    assert (config.task, config.gp.seed, config.gp.generations) == (STACK, 3, 2)


def test_what_the_process_refuses_is_said(evolution):
    task = dataclasses.replace(STACK, objects=(), targets=())
    evolution.start(task, GPConfig())
    until(evolution, "failed")
    assert "nothing to move" in evolution.sentence


@pytest.mark.parametrize(("stage", "shown"), [("evolving", "killed"), ("testing", "killed"), ("finished", "finished")])
def test_a_run_that_ended_while_no_page_was_open(tmp_path, stage, shown):
    evolution = EvolutionProcess(Workspace(tmp_path))
    left_behind(evolution.workspace, stage=stage)
    assert evolution.find() == "old"
    evolution.open("old")
    evolution.poll()
    assert evolution.stage == shown
    assert evolution.tree == parse_tree(TREE)


def test_a_run_folder_that_vanishes(tmp_path):
    evolution = EvolutionProcess(Workspace(tmp_path))
    folder = left_behind(evolution.workspace, stage="finished")
    evolution.open("old")
    evolution.poll()
    folder.path.rename(tmp_path / "elsewhere")
    assert evolution.poll()
    assert evolution.stage == "vanished"
    assert "choose another run" in evolution.sentence
    for request in (lambda: evolution.go_on(5), lambda: evolution.go_on(5, Changes(baseline=parse_tree(TREE)))):
        with pytest.raises(UserError, match="no longer there"):
            request()
    with pytest.raises(UserError, match="no longer there"):
        evolution.open("old")


def test_the_newest_run_is_shown_again_though_it_was_killed_before_it_wrote_its_tree(tmp_path):
    folder = left_behind(Workspace(tmp_path))
    for kind in ("txt", "xml", "svg"):
        (folder.path / f"best_tree.{kind}").unlink()
    studio = Studio(Workspace(tmp_path), load_task("pyramid"))
    studio.restore()
    assert (studio.playing.run, studio.edited.task, studio.playing.tree) == ("old", STACK, parse_tree(TREE))
    assert studio.evolution.stage == "killed"
    folder.path.joinpath("progress.json").unlink()
    studio.open_run("old")
    assert (studio.playing.tree, studio.evolution.stage) == (None, "stopped")


def test_a_run_is_deleted_and_forgotten_but_not_while_a_process_trains_there(tmp_path):
    studio = Studio(Workspace(tmp_path), STACK)
    folder = left_behind(studio.workspace, stage="finished")
    studio.open_run("old")
    with locked(folder.path), pytest.raises(UserError, match="stop it before"):
        asyncio.run(studio.delete_run("old"))
    asyncio.run(studio.delete_run("old"))
    studio.watch()
    assert (studio.playing.run, studio.evolution.run, studio.evolution.stage) == (None, None, "none")
    assert list(studio.workspace.runs.iterdir()) == []


def test_a_start_that_fails_changes_nothing(tmp_path, monkeypatch):
    evolution = EvolutionProcess(Workspace(tmp_path))
    left_behind(evolution.workspace, stage="finished")
    evolution.open("old")
    monkeypatch.setattr(
        "bt_jax.app.processes.warm_worker.WarmWorker.train", lambda *_: (_ for _ in ()).throw(UserError("it has died"))
    )
    with pytest.raises(UserError, match="died"):
        evolution.start(STACK, LONG)
    assert (evolution.run, evolution.stage, evolution.tree) == ("old", "finished", parse_tree(TREE))
    evolution.close()


def test_nothing_has_been_evolved(tmp_path):
    evolution = EvolutionProcess(Workspace(tmp_path))
    assert not evolution.poll()
    for request in (evolution.pause, evolution.resume, evolution.stop, lambda: evolution.go_on(5)):
        with pytest.raises(UserError, match=r"start an evolution first|nothing to resume"):
            request()
    with pytest.raises(UserError, match="8 to 100000"):
        evolution.start(STACK, GPConfig(population=2))
    assert not (tmp_path / "runs").exists()


def test_two_windows_hear_of_the_same_evolution(tmp_path):
    studio = Studio(Workspace(tmp_path), STACK)
    left_behind(studio.workspace, stage="finished")
    heard = []
    for window in range(2):
        studio.bus.subscribe("evolution", lambda window=window: heard.append(window))
    studio.open_run("old")
    studio.watch()
    assert {0, 1} <= set(heard)
    assert studio.playing.tree == parse_tree(TREE)
