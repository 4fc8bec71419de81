"""However a run is ended from outside, the arms hold and the log says why."""

import os
import signal

import pytest

from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.settings import Exit
from tests.helpers.ideal import IdealCell


def break_camera(cell):
    cell.image = 2.0


def pull_out_camera(cell):
    cell.image, cell.lost = 2.0, "its cable is out"


def raise_in_skills(cell):
    def poll(seen):
        raise RuntimeError("no plan survives")

    cell.skills.poll = poll


def press_ctrl_c(cell):
    os.kill(os.getpid(), signal.SIGINT)


def terminate(cell):
    os.kill(os.getpid(), signal.SIGTERM)


def stop_robot(cell):
    cell.link.stop("left: no feedback")


@pytest.mark.parametrize(
    ("fault", "code", "word"),
    [
        (break_camera, Exit.STOPPED, "camera: no new image for 2.0 s"),
        (pull_out_camera, Exit.STOPPED, "its cable is out"),
        (raise_in_skills, Exit.STOPPED, "no plan survives"),
        (press_ctrl_c, Exit.INTERRUPTED, "interrupted"),
        (terminate, Exit.INTERRUPTED, "interrupted"),
        (stop_robot, Exit.STOPPED, "no feedback"),
    ],
)
def test_every_fault_ends_in_a_hold_that_the_log_explains(tmp_path, fault, code, word):
    log = Log(tmp_path / "log.jsonl")
    cell = IdealCell(log=log)
    cell.on_tick = lambda shown: fault(cell) if len(cell.shown) == 5 else None
    outcome = cell.executor.run()
    log.close()
    entries = list(read_log(tmp_path / "log.jsonl"))
    assert outcome.exit_code == entries[-1]["exit_code"] == code
    assert word in outcome.reason
    assert entries[-1]["reason"] == outcome.reason
    assert word in cell.link.stopped()
    assert fault is stop_robot or set(cell.link.halted) == {"left", "right"}


def test_what_is_not_certain_of_a_stop_stands_in_its_reason_and_in_the_log(tmp_path, monkeypatch):
    log = Log(tmp_path / "log.jsonl")
    cell = IdealCell(log=log)
    monkeypatch.setattr(cell.link, "stop", lambda reason: "not confirmed: press the stop")
    cell.on_tick = lambda shown: break_camera(cell)
    outcome = cell.executor.run()
    log.close()
    assert outcome.reason.startswith("camera: no new image")
    assert outcome.reason.endswith("; not confirmed: press the stop")
    assert list(read_log(tmp_path / "log.jsonl"))[-1]["reason"] == outcome.reason


def test_ctrl_c_many_times_is_as_once():
    cell = IdealCell()

    def press(shown):
        for _ in range(3):
            os.kill(os.getpid(), signal.SIGINT)

    cell.on_tick = press
    assert cell.executor.run().exit_code == Exit.INTERRUPTED
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_ctrl_c_while_the_arms_come_to_rest_is_as_once():
    cell = IdealCell()
    cell.on_tick = lambda shown: os.kill(os.getpid(), signal.SIGINT)
    wait = cell.link.wait

    def press(until):
        os.kill(os.getpid(), signal.SIGINT)
        wait(until)

    cell.link.wait = press
    assert cell.executor.run().exit_code == Exit.INTERRUPTED
    assert cell.link.stopped() == "interrupted"


def test_the_arms_hold_also_where_the_log_cannot_be_written(tmp_path):
    class Full(Log):
        def write(self, kind, **fields):
            if kind != "start":
                raise OSError(28, "No space left on device")

    with Full(tmp_path / "log.jsonl") as log:
        cell = IdealCell(log=log)
        outcome = cell.executor.run()
    assert outcome.exit_code == Exit.STOPPED
    assert "No space left" in outcome.reason
    assert cell.link.stopped() == outcome.reason
