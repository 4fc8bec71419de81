"""check and run against a twin that stands in for the robot: real time, sockets, images and all."""

import os
import signal
import sys
import threading
import time

import httpx
import numpy as np
import pytest

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands.arguments import REDUCED_SPEED, CheckArguments, RunArguments
from bt_jax.deploy.commands.check import check_command
from bt_jax.deploy.commands.run import SENTENCE, confirm, run_command
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.log_reader import read_log
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.deploy.twin.network import free_ports
from tests.helpers.real_cells import TREE, connected
from tests.helpers.terminal import Terminal


@pytest.fixture
def at_a_terminal(monkeypatch):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)


def arm_joints(controller):
    return controller.state()[1][-18:].copy()


@pytest.mark.realtime
def test_check_passes_on_a_good_cell(tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        console = Terminal("")
        code = check_command(CheckArguments(**arguments), console)
        assert code == Exit.DONE, console.said
        assert console.said.count("✓") == 17


@pytest.mark.realtime
def test_check_fails_where_something_is_missing(tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        console = Terminal("")
        assert check_command(CheckArguments(**{**arguments, "camera": None, "twin_log": None}), console) == Exit.FAILED
        assert "--twin-log" in console.said
        assert "--camera" in console.said


def test_check_without_a_controller_tells_all_that_can_be_known(tmp_path, monkeypatch):
    """A broken calibration, a camera and a controller that are not there hide nothing, and no address is contacted."""
    monkeypatch.setattr(httpx.Client, "send", lambda *_, **__: pytest.fail("somebody was contacted"))
    (tmp_path / "tree.txt").write_text(TREE)
    (tmp_path / "camera.yaml").write_text("camera: 1\n")
    console = Terminal("")
    left, right = free_ports(("left", "right")).values()
    arguments = CheckArguments(
        tmp_path / "tree.txt", camera="0", calibration=tmp_path / "camera.yaml", ports=(left, right)
    )
    assert check_command(arguments, console) == Exit.FAILED
    lines = {line[2:38].strip(): line for line in console.said.splitlines() if line[0] in "✓✗-"}
    assert len(lines) == 17
    for name in (
        "tree: every leaf is known",
        "payload: boxes and gripper",
        "arms: home is clear",
        "computer: UDP ports",
    ):
        assert lines[name].startswith("✓"), lines[name]
    assert "--robot" in lines["controller: state"]
    assert "camera.yaml" in lines["camera: intrinsics"]
    assert "--twin-log" in lines["twin: this tree ran there"]


def test_run_shows_what_check_does_before_it_ends_without_a_controller(tmp_path):
    (tmp_path / "tree.txt").write_text(TREE)
    person = Terminal("")
    with pytest.raises(UserError, match="--robot"):
        run_command(RunArguments(tmp_path / "tree.txt", ports=tuple(free_ports(("left", "right")).values())), person)
    assert "payload: boxes and gripper" in person.said


@pytest.mark.realtime
def test_a_dry_run_plans_and_moves_nothing(tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (controller, _, arguments):
        before = arm_joints(controller)
        log = tmp_path / "dry.jsonl"
        person = Terminal("")
        code = run_command(RunArguments(**arguments, seconds=6.0, log=log), person)
        assert code == Exit.FAILED
        np.testing.assert_allclose(arm_joints(controller), before, atol=1e-4)
        planned = [entry for entry in read_log(log) if entry["kind"] == "action"]
        assert [(entry["action"], entry["event"]) for entry in planned] == [("pick(YellowBox)", "planned")]
        assert planned[0]["reason"] == "as far as to its first motion"
        assert controller.stats().unanswered == 0


@pytest.mark.realtime
def test_a_dry_run_that_ends_early_has_stopped_no_robot(tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (controller, cameras, arguments):
        thread = threading.Timer(9.0, lambda: lose_camera(controller, cameras))
        thread.start()
        person = Terminal("")
        code = run_command(RunArguments(**arguments, seconds=60.0, log=tmp_path / "dry.jsonl"), person)
        thread.join()
        assert code == Exit.STOPPED
        assert "camera" in person.said
        assert "protective stop" not in person.said


@pytest.mark.parametrize("typed", ["", "yes", SENTENCE.upper(), SENTENCE[:-1], f"{SENTENCE}!"])
def test_another_sentence_confirms_nothing(at_a_terminal, typed):
    with pytest.raises(UserError, match="not confirmed"):
        confirm(Terminal(typed))
    confirm(Terminal(SENTENCE))


@pytest.mark.realtime
def test_motion_needs_the_sentence(at_a_terminal, tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (controller, _, arguments):
        before = arm_joints(controller)
        person = Terminal("yes")
        with pytest.raises(UserError) as refused:
            run_command(RunArguments(**arguments, motion=True), person)
        assert "not confirmed" in str(refused.value), person.said
        np.testing.assert_allclose(arm_joints(controller), before, atol=1e-4)


@pytest.mark.realtime
@pytest.mark.slow
def test_motion_needs_a_terminal_and_a_passed_preflight(at_a_terminal, monkeypatch, tmp_path):
    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        with pytest.raises(UserError, match="preflight"):
            run_command(RunArguments(**{**arguments, "twin_log": None}, motion=True), Terminal(SENTENCE))
        monkeypatch.setattr(sys.stdin, "isatty", lambda: False, raising=False)
        with pytest.raises(UserError, match="terminal"):
            run_command(RunArguments(**arguments, motion=True), Terminal(SENTENCE))


@pytest.mark.realtime
@pytest.mark.slow
def test_motion_is_slow(at_a_terminal, tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        log = tmp_path / "run.jsonl"
        run_command(RunArguments(**arguments, motion=True, seconds=8.0, log=log), Terminal(SENTENCE))
        speeds = [
            np.abs(np.diff(entry["setpoint"], axis=0)) / np.diff(entry["time"])[:, None]
            for entry in read_log(log)
            if entry["kind"] == "motion" and len(entry["time"]) > 1
        ]
        assert speeds, "nothing moved"
        fastest = max(speed.max() for speed in speeds)
        assert 0.1 < fastest < 0.2 * 1.3, "differences of rounded numbers"


def lose_camera(controller, cameras):
    cameras[-1].lose()


def kill(controller, cameras):
    controller.kill()


def stop_by_hand(controller, cameras):
    controller.fault("emergency_stop")


def press_ctrl_c(controller, cameras):
    os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.realtime
@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "code", "word", "seconds"),
    [
        (lose_camera, Exit.STOPPED, "camera", Limits.image + 1.0),
        (kill, Exit.STOPPED, "no feedback", 1.0),
        (stop_by_hand, Exit.STOPPED, "not running", 1.0),
        (press_ctrl_c, Exit.INTERRUPTED, "interrupted", 1.0),
    ],
)
def test_faults_in_mid_motion_hold_the_arms(at_a_terminal, tmp_path, fault, code, word, seconds, monkeypatch):
    """They come to rest within `seconds`: at their speed they get no further."""
    with connected(tmp_path, monkeypatch) as (controller, cameras, arguments):
        struck, log, over = [], tmp_path / "run.jsonl", threading.Event()

        def break_it():
            start = arm_joints(controller)
            while not over.wait(0.05):
                if np.abs(arm_joints(controller) - start).max() >= 0.1:
                    struck.append(arm_joints(controller))
                    fault(controller, cameras)
                    return

        thread = threading.Thread(target=break_it)
        person = Terminal(SENTENCE)
        before = signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C is meant for the run, not for who tests
        try:
            thread.start()
            found = run_command(RunArguments(**arguments, motion=True, seconds=90.0, log=log), person)
        finally:
            over.set()
            thread.join()
            signal.signal(signal.SIGINT, before)
        end = list(read_log(log))[-1]
        assert struck, end["reason"]
        assert ("protective stop" in person.said) == (code == Exit.STOPPED)
        assert (found, end["exit_code"]) == (code, code)
        assert word in end["reason"]
        if controller.alive:
            held = arm_joints(controller)
            assert np.abs(held - struck[0]).max() < REDUCED_SPEED * seconds
            time.sleep(0.5)
            np.testing.assert_allclose(arm_joints(controller), held, atol=1e-3)


@pytest.mark.realtime
def test_a_person_hears_of_the_last_stop_before_the_sentence(at_a_terminal, tmp_path, monkeypatch):
    with connected(tmp_path, monkeypatch) as (_, _, arguments):
        with Log(tmp_path / "robot-1.jsonl") as log:
            log.write("start", format=1, dry=False, settings={"preflight": []})
            log.write("end", exit_code=Exit.STOPPED, reason="left: no feedback")
        person = Terminal("no")
        with pytest.raises(UserError) as refused:
            run_command(RunArguments(**arguments, motion=True, log=tmp_path / "robot-2.jsonl"), person)
        assert "not confirmed" in str(refused.value), person.said
        assert "The last run was stopped: left: no feedback" in person.said
