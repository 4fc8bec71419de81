"""A rehearsal as a person does it: the twin serves in one terminal, and other commands work with it from another."""

import contextlib
import os
import pty
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import tyro

from bt_jax.deploy.__main__ import main
from bt_jax.deploy.commands.arguments import CheckArguments, TwinArguments
from bt_jax.deploy.commands.run import SENTENCE
from bt_jax.deploy.commands.serve import check_line
from bt_jax.deploy.execution.log import Log
from bt_jax.deploy.execution.program import load_program
from bt_jax.deploy.execution.settings import Exit
from bt_jax.deploy.robot.yumi import YUMI
from bt_jax.deploy.twin.network import free_ports
from bt_jax.mjx_env.render.offscreen import available

TREE = "move(YellowBox, (0, 0, 0.021), KittingBox)\n"
TASK = """extends: yumi_stack
name: one_box
targets:
  - {object: YellowBox, position: [0, 0, 0.021], frame: KittingBox}
"""
LIGHT = ["--realism.width", "640", "--realism.height", "480", "--realism.blur", "0.35", "--realism.rate", "5"]
STARVED = re.compile("check the camera's cable|no new image|no feedback for|no sign of life|were lost; use a cable")
PLAIN = {**os.environ, "TERM": "dumb", "COLUMNS": "200"}


@contextlib.contextmanager
def served(folder):
    """The twin in a process of its own; yields the words by which other commands reach it, and its output."""
    (folder / "tree.txt").write_text(TREE)
    (folder / "task.yaml").write_text(TASK)
    left, right = free_ports(YUMI.arm_names).values()
    tree = ["tree.txt", "--task", "task.yaml"]
    words = [*tree, "--serve", "--seed", "3", "--ports", str(left), str(right), "--rws-port", "0", "--camera-port", "0"]
    with open(folder / "served.txt", "w") as said:
        twin = subprocess.Popen(command("twin", *words, *LIGHT), cwd=folder, stdout=said, stderr=subprocess.STDOUT)
    try:
        deadline = time.monotonic() + 60
        while "Ctrl-C" not in (folder / "served.txt").read_text():
            running = twin.poll() is None and time.monotonic() < deadline
            assert running, (folder / "served.txt").read_text()
            time.sleep(0.2)
        text = (folder / "served.txt").read_text()
        rws = re.search(r"Web Services at port (\d+)", text)[1]
        camera = re.search(r"http://[\d.]+:\d+/", text)[0]
        yield [
            *(*tree, "--robot", "127.0.0.1", "--rws-port", rws, "--ports", str(left), str(right)),
            *("--camera", camera, "--calibration", "twin_camera.yaml"),
        ]
    finally:
        twin.send_signal(signal.SIGINT)
        twin.wait(20)
    assert twin.returncode == Exit.DONE
    assert "unanswered" in (folder / "served.txt").read_text()


def command(*words):
    return [sys.executable, "-m", "bt_jax.deploy", *words]


def skip_where_starved(said):
    if found := STARVED.search(said):
        line = said[said.rfind("\n", 0, found.start()) + 1 :].splitlines()[0]
        pytest.skip(f"this machine is too busy for two programs in real time: {line}")


needs_renderer = pytest.mark.skipif(available() is not True, reason=f"needs a renderer: {available()}")


@needs_renderer
@pytest.mark.realtime
@pytest.mark.slow
def test_check_passes_on_a_twin_in_another_process(tmp_path):
    with served(tmp_path) as words:
        found = subprocess.run(
            command("check", *words), cwd=tmp_path, env=PLAIN, capture_output=True, text=True, timeout=120
        )
    skip_where_starved(found.stdout)
    assert found.returncode == Exit.FAILED, "no log of the twin was given"
    bad = [line for line in found.stdout.splitlines() if not line.startswith("✓")]
    assert len(bad) == 1, found.stdout + found.stderr
    assert bad[0].startswith("✗ twin: this tree ran there")


@needs_renderer
@pytest.mark.realtime
@pytest.mark.slow
def test_a_tree_runs_with_motion_on_a_twin_in_another_process(tmp_path):
    with served(tmp_path) as words:
        program = load_program(tmp_path / "tree.txt", str(tmp_path / "task.yaml"))
        with Log(tmp_path / "twin.jsonl") as log:
            settings = {"robot": "twin"}
            log.write(
                "start", format=1, digest=program.digest, task=program.task.to_dict(), dry=False, settings=settings
            )
            log.write("end", exit_code=0, seconds=1.0, ticks=10)
        options = ["--twin-log", "twin.jsonl", "--motion", "--log", "run.jsonl", "--seconds", "240"]
        code, said = typed(command("run", *words, *options), SENTENCE, tmp_path)
    if code != Exit.DONE:
        skip_where_starved(said)
    assert code == Exit.DONE, said
    assert "the tree has succeeded" in said


def typed(words, answer, folder):
    """Run a command at a terminal where somebody types an answer once asked; return exit code and what was said."""
    ours, theirs = pty.openpty()
    process = subprocess.Popen(words, cwd=folder, env=PLAIN, stdin=theirs, stdout=theirs, stderr=theirs)
    os.close(theirs)
    said, answered = b"", False
    while True:
        try:
            said += os.read(ours, 4096)
        except OSError:  # the other end was closed
            break
        if not answered and b"to go on:" in said:
            os.write(ours, answer.encode() + b"\n")
            answered = True
    os.close(ours)
    return process.wait(20), said.decode(errors="replace")


@pytest.mark.parametrize("task", [None, "my tasks/one box.yaml"])
def test_the_printed_line_checks_what_is_served(task):
    served = TwinArguments(Path("my tree.txt"), task, serve=True, ports=(7001, 7002), calibration=Path("a cell.yaml"))
    line = shlex.split(check_line(served, 8081, "http://127.0.0.1:8090/"))
    assert line[:4] == ["python", "-m", "bt_jax.deploy", "check"]
    checked = tyro.cli(CheckArguments, args=line[4:])
    assert checked == CheckArguments(
        served.source,
        task,
        robot="127.0.0.1",
        camera="http://127.0.0.1:8090/",
        calibration=served.calibration,
        rws_port=8081,
        ports=served.ports,
    )


@pytest.mark.parametrize("words", [["--layouts", "3"], ["--disturb"], ["--log", "x.jsonl"], ["--render", "x.mp4"]])
def test_what_needs_a_tree_is_refused_with_serve(capsys, words):
    assert main(["twin", "--serve", *words]) == Exit.USER_ERROR
    assert "--serve executes no tree" in capsys.readouterr().err


def test_a_twin_without_a_tree_says_what_is_missing(capsys):
    assert main(["twin"]) == Exit.USER_ERROR
    assert "a tree is missing" in capsys.readouterr().err
