import contextlib
import dataclasses
import os
import shlex
import time

import pytest
import tyro

from bt_jax._util.errors import UserError
from bt_jax.deploy.commands import run as module
from bt_jax.deploy.commands.arguments import RealCellArguments, RecoverArguments, RunArguments
from bt_jax.deploy.commands.run import AGAIN, SENTENCE, last_stop, recover_line, run_command
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.settings import Exit, Limits
from tests.helpers.terminal import Terminal


@pytest.mark.parametrize(("name", "value"), [("speed", 0.5), ("speed", 0.0), ("seconds", -1.0)])
def test_arguments_that_cannot_work_are_refused(tmp_path, name, value):
    with contextlib.ExitStack() as stack:
        stack.enter_context(pytest.raises(UserError, match=f"--{name}"))
        run_command(RunArguments(tmp_path / "tree.txt", **{name: value}), Terminal(""))


def test_no_recording_is_the_eyes_of_a_robot_that_moves(tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"")
    for recording in (tmp_path, tmp_path / "film.mp4"):
        with pytest.raises(UserError, match=r"recording.*leave out --motion"):
            run_command(RunArguments(tmp_path / "tree.txt", camera=str(recording), motion=True), Terminal(SENTENCE))
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


def test_help_says_that_no_command_resets_a_stop():
    assert "no command resets it" in " ".join(RunArguments.__doc__.split())


def test_the_password_is_not_logged():
    told = module._logged(RunArguments(source=module.Path("x"), password="secret"))
    assert "secret" not in str(told)


def test_what_a_stop_prints_is_a_command_that_recover_takes(tmp_path):
    arguments = RunArguments(
        tmp_path / "a tree.txt", task="yumi_stack", robot="192.168.125.1", camera="0", ports=(6611, 6612), password="x",
        motion=True, speed=0.1, seconds=20.0, log=tmp_path / "log.jsonl",
    )  # fmt: skip
    line = recover_line(arguments)
    words = shlex.split(line)
    assert words[:4] == ["python", "-m", "bt_jax.deploy", "recover"]
    read = tyro.cli(RecoverArguments, args=words[4:])
    for field in dataclasses.fields(RealCellArguments):
        expected = "PASSWORD" if field.name == "password" else getattr(arguments, field.name)
        assert getattr(read, field.name) == expected
    assert "go_ready" in AGAIN, "BtJax begins at its ready targets only, and home need not be there"
