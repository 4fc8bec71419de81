"""One process compiles ahead, and only for what is new."""

import dataclasses

import pytest

from bt_jax.app.processes.standby import Standby
from bt_jax.app.processes.train_command import TrainCommand
from bt_jax.app.processes.warm_worker import WarmWorker
from bt_jax.gp.config import GPConfig
from bt_jax.tasks import load_task

STACK = load_task("stack")


class Worker(WarmWorker):
    """What the page does with a worker, without the process."""

    alive = True

    def __init__(self):
        self.warmed = []

    def warm(self, words):
        self.warmed.append(words)

    def discard(self):
        self.alive = False


@pytest.fixture
def started(monkeypatch):
    started = []
    monkeypatch.setattr("bt_jax.app.processes.standby.WarmWorker", lambda: started.append(Worker()) or started[-1])
    return started


def test_it_compiles_once_for_evolutions_that_need_the_same_code(tmp_path, started):
    standby, first = Standby(TrainCommand(tmp_path), worker := Worker()), worker
    standby.prepare(STACK, GPConfig())
    standby.prepare(STACK, dataclasses.replace(GPConfig(), seed=5, generations=7))
    assert (len(first.warmed), started) == (1, [])
    standby.prepare(load_task("restack"), GPConfig())
    assert not first.alive
    assert standby.take() is started[0]
    assert standby.take() is started[1]  # another, since the first one trains


def test_a_worker_that_has_died_is_replaced(tmp_path, started):
    standby, first = Standby(TrainCommand(tmp_path), worker := Worker()), worker
    standby.prepare(STACK, GPConfig())
    first.alive = False
    standby.prepare(STACK, GPConfig())
    assert len(started[0].warmed) == 1


def test_a_flood_of_other_tasks_leaves_one_process(tmp_path, started):
    standby = Standby(TrainCommand(tmp_path))
    for i in range(60):
        standby.prepare(load_task(("stack", "restack")[i % 2]), GPConfig())
        assert sum(worker.alive for worker in started) == 1
    standby.discard()
    assert not any(worker.alive for worker in started)
