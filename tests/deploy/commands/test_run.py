"""check and run against a twin that stands in for the robot: real time, sockets, images and all."""

import contextlib
import dataclasses
import io
import os
import re
import signal
import sys
import threading
import time

import numpy as np
import pytest
from rich.console import Console

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands import real_cell
from bt_jax.deploy.commands import run as module
from bt_jax.deploy.commands.arguments import FASTEST, CheckArguments, RunArguments
from bt_jax.deploy.commands.check import check_command
from bt_jax.deploy.commands.run import SENTENCE, last_stop, run_command
from bt_jax.deploy.execution import preflight
from bt_jax.deploy.execution.log import Log, read_log
from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.execution.settings import Exit, Limits
from bt_jax.deploy.perception.calibration import CameraPose, Intrinsics, save_camera
from bt_jax.deploy.twin.cell import build_scene
from bt_jax.deploy.twin.controller import Controller
from bt_jax.deploy.twin.rendered_camera import RenderedCamera, cell_camera
from bt_jax.tasks import load_task
from tests.helpers.cells import free_ports

TASK = load_task("yumi_stack")
TREE = "move(YellowBox, (0, 0, 0.021), KittingBox)\n"


class Camera(RenderedCamera):
    """Draws again only when something has moved: everything else runs in real time on the same cores."""

    drawn = None

    def read(self):
        time, qpos = self._state()
        if self.drawn is None or self._lost or np.abs(qpos - self.drawn[0]).max() > 1e-4:
            self.drawn = qpos, super().read()
        return dataclasses.replace(self.drawn[1], time=float(time))


@pytest.fixture
def robot(tmp_path, monkeypatch):
    """The controller, and the arguments with which it is reached."""
    scene, ports = build_scene(TASK, 3), free_ports()
    (tmp_path / "tree.txt").write_text(TREE)
    program = load_program(tmp_path / "tree.txt")
    with Log(tmp_path / "twin.jsonl") as log:
        log.write("start", format=1, digest=program.digest, task=TASK.to_dict(), dry=False, settings={"robot": "twin"})
        log.write("end", exit_code=0, seconds=1.0, ticks=10)
    place = cell_camera(TASK)
    lens = Intrinsics(place.matrix, np.zeros(5), place.width, place.height, 0.1)
    save_camera(tmp_path / "camera.yaml", lens, CameraPose(place.pose, 0.001, 8))
    with Controller(scene.cell, ports=ports, realtime=True) as controller:
        try:
            RenderedCamera(scene.model, controller.state).close()
        except Exception as problem:
            pytest.skip(f"no renderer: {problem}")
        cameras = []

        def open_camera(source, lens):
            cameras.append(Camera(scene.model, controller.state))
            return cameras[-1]

        monkeypatch.setattr(real_cell, "open_camera", open_camera)
        monkeypatch.setattr(preflight, "IMAGE", 5.0)  # the twin renders on the cores on which everything else runs
        controller.cameras = cameras
        arguments = {
            "source": tmp_path / "tree.txt",
            "robot": "127.0.0.1",
            "rws_port": controller.rws_port,
            "ports": (ports["left"], ports["right"]),
            "camera": "0",
            "calibration": tmp_path / "camera.yaml",
            "twin_log": tmp_path / "twin.jsonl",
        }
        yield controller, arguments


class Person(Console):
    """Types something."""

    def __init__(self, typed):
        super().__init__(file=io.StringIO(), width=160)
        self.typed = typed

    def input(self, *_, **__):
        return self.typed

    @property
    def said(self):
        return self.file.getvalue()


def skip_where_starved(person):
    """Real time needs a machine that has some: an image every fifth of a second."""
    images = re.search(r"(\d+) images in", person.said)
    if images is not None and int(images[1]) < 10:
        pytest.skip(f"this machine is too busy for real time: {images[0]} 2 s")


@pytest.fixture
def at_a_terminal(monkeypatch):
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)


def arm_joints(controller):
    return controller.state()[1][-18:].copy()


@pytest.mark.realtime
def test_check_passes_on_a_good_cell(robot):
    _, arguments = robot
    console = Person("")
    code = check_command(CheckArguments(**arguments), console)
    skip_where_starved(console)
    assert code == Exit.DONE, console.said
    assert console.said.count("✓") == 13


@pytest.mark.realtime
def test_check_fails_where_something_is_missing(robot):
    _, arguments = robot
    console = Person("")
    assert check_command(CheckArguments(**{**arguments, "camera": None, "twin_log": None}), console) == Exit.FAILED
    assert "--twin-log" in console.said
    assert "--camera" in console.said


@pytest.mark.realtime
def test_a_dry_run_plans_and_moves_nothing(robot, tmp_path):
    controller, arguments = robot
    before = arm_joints(controller)
    log = tmp_path / "dry.jsonl"
    person = Person("")
    code = run_command(RunArguments(**arguments, seconds=6.0, log=log), person)
    skip_where_starved(person)
    assert code == Exit.FAILED
    np.testing.assert_allclose(arm_joints(controller), before, atol=1e-4)
    planned = [entry for entry in read_log(log) if entry["kind"] == "action"]
    assert [(entry["action"], entry["event"]) for entry in planned] == [("pick(YellowBox)", "planned")]
    assert planned[0]["reason"] == "as far as to its first motion"
    assert controller.stats().unanswered == 0


@pytest.mark.realtime
def test_a_dry_run_that_ends_early_has_stopped_no_robot(robot, tmp_path):
    controller, arguments = robot
    thread = threading.Timer(9.0, lambda: lose_camera(controller))
    thread.start()
    person = Person("")
    code = run_command(RunArguments(**arguments, seconds=60.0, log=tmp_path / "dry.jsonl"), person)
    thread.join()
    assert code == Exit.STOPPED
    assert "camera" in person.said
    assert "protective stop" not in person.said


@pytest.mark.realtime
@pytest.mark.parametrize("typed", ["", "yes", SENTENCE.upper()])
def test_motion_needs_the_sentence(robot, at_a_terminal, typed):
    controller, arguments = robot
    before = arm_joints(controller)
    person = Person(typed)
    with pytest.raises(UserError) as refused:
        run_command(RunArguments(**arguments, motion=True), person)
    skip_where_starved(person)
    assert "not confirmed" in str(refused.value), person.said
    np.testing.assert_allclose(arm_joints(controller), before, atol=1e-4)


@pytest.mark.realtime
@pytest.mark.slow
def test_motion_needs_a_terminal_and_a_passed_preflight(robot, at_a_terminal, monkeypatch):
    _, arguments = robot
    with pytest.raises(UserError, match="preflight"):
        run_command(RunArguments(**{**arguments, "twin_log": None}, motion=True), Person(SENTENCE))
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False, raising=False)
    with pytest.raises(UserError, match="terminal"):
        run_command(RunArguments(**arguments, motion=True), Person(SENTENCE))


@pytest.mark.realtime
@pytest.mark.slow
def test_motion_is_slow(robot, at_a_terminal, tmp_path):
    _, arguments = robot
    log = tmp_path / "run.jsonl"
    run_command(RunArguments(**arguments, motion=True, seconds=8.0, log=log), Person(SENTENCE))
    speeds = [
        np.abs(np.diff(entry["setpoint"], axis=0)) / np.diff(entry["time"])[:, None]
        for entry in read_log(log)
        if entry["kind"] == "motion" and len(entry["time"]) > 1
    ]
    fastest = max(speed.max() for speed in speeds)
    assert 0.1 < fastest < 0.2 * 1.3, "differences of rounded numbers"


def lose_camera(controller):
    controller.cameras[-1].lose()


def kill(controller):
    controller.kill()


def stop_by_hand(controller):
    controller.fault("emergency_stop")


def press_ctrl_c(controller):
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
def test_faults_in_mid_motion_hold_the_arms(robot, at_a_terminal, tmp_path, fault, code, word, seconds):
    """They come to rest within `seconds`: at their speed they get no further."""
    controller, arguments = robot
    struck, log, over = [], tmp_path / "run.jsonl", threading.Event()

    def break_it():
        start = arm_joints(controller)
        while not over.wait(0.05):
            if np.abs(arm_joints(controller) - start).max() >= 0.1:
                struck.append(arm_joints(controller))
                fault(controller)
                return

    thread = threading.Thread(target=break_it)
    person = Person(SENTENCE)
    before = signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C is meant for the run, not for who tests
    try:
        thread.start()
        found = run_command(RunArguments(**arguments, motion=True, seconds=90.0, log=log), person)
    finally:
        over.set()
        thread.join()
        signal.signal(signal.SIGINT, before)
    skip_where_starved(person)
    end = list(read_log(log))[-1]
    if not struck and "no new image" in end["reason"]:
        pytest.skip(f"this machine is too busy for real time: {end['reason']}")
    assert struck, end["reason"]
    assert ("protective stop" in person.said) == (code == Exit.STOPPED)
    assert (found, end["exit_code"]) == (code, code)
    assert word in end["reason"]
    if controller.alive:
        held = arm_joints(controller)
        assert np.abs(held - struck[0]).max() < FASTEST * seconds
        time.sleep(0.5)
        np.testing.assert_allclose(arm_joints(controller), held, atol=1e-3)


@pytest.mark.parametrize(("name", "value"), [("speed", 0.5), ("speed", 0.0), ("seconds", -1.0)])
def test_arguments_that_cannot_work_are_refused(tmp_path, name, value):
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.raises(UserError, match=f"--{name}"))
        run_command(RunArguments(tmp_path / "tree.txt", **{name: value}), Person(""))


def test_no_recording_is_the_eyes_of_a_robot_that_moves(tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"")
    for recording in (tmp_path, tmp_path / "film.mp4"):
        with pytest.raises(UserError, match=r"recording.*leave out --motion"):
            run_command(RunArguments(tmp_path / "tree.txt", camera=str(recording), motion=True), Person(SENTENCE))
        RunArguments(tmp_path / "tree.txt", camera=str(recording)).check()
    for camera in ("0", "rtsp://10.0.0.2/stream", "/dev/null"):
        RunArguments(tmp_path / "tree.txt", camera=camera, motion=True).check()


def test_an_attempt_has_the_time_that_its_speed_needs():
    fast, slow = (RunArguments(module.Path("x"), speed=speed).limits.action for speed in (0.2, 0.05))
    assert fast > 2 * 62, "seconds of motion, measured at 0.2 rad/s, and of one new plan"
    assert slow == pytest.approx(4 * fast)
    assert Limits().action < fast


def a_log(path, *, code, dry=False, finished=True, preflight=True):
    with Log(path) as log:
        log.write("start", format=1, dry=dry, settings={"preflight": []} if preflight else {})
        if finished:
            log.write("end", exit_code=code, reason="left: no feedback")


def test_the_last_stop_is_told(tmp_path):
    assert last_stop(tmp_path / "nothing") is None
    a_log(tmp_path / "1.jsonl", code=Exit.STOPPED)
    assert "left: no feedback" in last_stop(tmp_path)
    for number, changes in enumerate([{"dry": True}, {"preflight": False}], start=2):
        a_log(tmp_path / f"{number}.jsonl", code=Exit.DONE, **changes)
        os.utime(tmp_path / f"{number}.jsonl", (time.time() + number, time.time() + number))
    (tmp_path / "4.jsonl").write_text("no log\n")
    assert "1.jsonl" in last_stop(tmp_path), "neither dry runs nor those in the twin nor other files count"
    a_log(tmp_path / "5.jsonl", code=Exit.DONE)
    os.utime(tmp_path / "5.jsonl", (time.time() + 9, time.time() + 9))
    assert last_stop(tmp_path) is None
    a_log(tmp_path / "6.jsonl", code=0, finished=False)
    os.utime(tmp_path / "6.jsonl", (time.time() + 99, time.time() + 99))
    assert "without saying why" in last_stop(tmp_path)


@pytest.mark.realtime
def test_a_person_hears_of_the_last_stop_before_the_sentence(robot, at_a_terminal, tmp_path):
    _, arguments = robot
    a_log(tmp_path / "robot-1.jsonl", code=Exit.STOPPED)
    person = Person("no")
    with pytest.raises(UserError) as refused:
        run_command(RunArguments(**arguments, motion=True, log=tmp_path / "robot-2.jsonl"), person)
    skip_where_starved(person)
    assert "not confirmed" in str(refused.value), person.said
    assert "The last run was stopped: left: no feedback" in person.said


def test_help_says_that_no_command_resets_a_stop():
    assert "no command resets it" in " ".join(RunArguments.__doc__.split())


def test_the_password_is_not_logged():
    told = module._logged(RunArguments(source=module.Path("x"), password="secret"))
    assert "secret" not in str(told)
