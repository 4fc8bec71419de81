"""The process of the robot's twin is told what to do, says what it does, and never outlives the page."""

import subprocess
import sys
import time

import pytest

from bt_jax._util.errors import UserError
from bt_jax.app.processes.twin_messages import (
    Check,
    Ended,
    Item,
    Job,
    Person,
    Picture,
    Replay,
    Request,
    Run,
    Show,
    Tick,
    read_job,
    read_message,
    read_request,
    to_line,
)
from bt_jax.app.processes.twin_process import TwinProcess
from bt_jax.tasks import load_task

RUN = Run("pick(YellowBox)", {}, 0, "log")
ECHO = """
import sys
from bt_jax.app.processes.twin_messages import Said, read_job, read_request, to_line
def say(text):
    sys.stdout.buffer.write(to_line(Said(text, refused=False)))
    sys.stdout.buffer.flush()
say(read_job(sys.stdin.buffer.readline()).tree)
try:
    for line in sys.stdin.buffer:
        say(read_request(line).what)
except KeyboardInterrupt:
    say("interrupted")
"""


def echo(script=ECHO):
    return TwinProcess(RUN, (sys.executable, "-c", script))


def heard(process, count):
    """What it says until there are so many sentences, or it has ended."""
    found = []
    while len(found) < count and process.alive:
        found += process.take()
        time.sleep(0.01)
    return [said.text for said in found]


@pytest.mark.parametrize(
    "message",
    [
        RUN,
        Check("pick(YellowBox)", load_task("yumi_stack").to_dict(), None),
        Replay("log"),
        Person("carry", start=(0.1, 0.2), end=(0.3, 0.4)),
        Show(3),
        Tick(0.1, "0.2", "acting", None, None, ["x is not seen"], [], {"x": None}),
        Picture("camera", b"\xff\xd8\n"),
        Item("tree", None, "needs it"),
        Ended("done", 1.0, solved=True, interrupted=False),
    ],
)
def test_every_message_is_one_line_that_is_read_back(message):
    line = to_line(message)
    assert line.count(b"\n") == 1
    read = read_job if isinstance(message, Job) else read_request if isinstance(message, Request) else read_message
    assert read(line) == message


def test_it_does_as_it_is_told_until_it_is_interrupted():
    process = echo()
    process.tell(Person("push", "YellowBox"))
    assert heard(process, 2) == ["pick(YellowBox)", "push"]
    process.interrupt()
    assert heard(process, 1) == ["interrupted"]
    process.close()
    assert not process.alive
    with pytest.raises(UserError, match="the robot's twin has ended; start it again"):
        process.tell(Person("push", "YellowBox"))


def test_what_does_not_end_in_order_is_killed_with_its_own_processes(monkeypatch):
    monkeypatch.setattr("bt_jax.app.processes.twin_process.PATIENCE", 0.2)
    stubborn = """
import signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
from bt_jax.app.processes.twin_messages import Said, to_line
sys.stdout.buffer.write(to_line(Said(str(child.pid), refused=False)))
sys.stdout.buffer.flush()
time.sleep(600)
"""
    process = echo(stubborn)
    (child,) = heard(process, 1)
    process.close()
    assert not process.alive
    listed = subprocess.run(["ps", "-o", "stat=", "-p", child], capture_output=True, text=True).stdout.strip()
    assert listed in ("", "Z") or listed.startswith("Z")


@pytest.mark.filterwarnings("error::pytest.PytestUnhandledThreadExceptionWarning")
def test_half_a_line_of_a_process_that_dies_is_no_message():
    process = echo("print('{\"type\":\"Said\",', end='')")
    assert heard(process, 1) == []


def test_its_last_words_are_kept():
    process = echo("import sys; sys.exit('error: the cell is on fire')")
    assert heard(process, 1) == []
    assert process.last_words() == "the cell is on fire"


@pytest.mark.slow
def test_the_preflight_looks_at_all_that_needs_no_robot():
    process = TwinProcess(Check("pick(YellowBox)", load_task("yumi_stack").to_dict(), None))
    items = []
    while process.alive:
        items += process.take()
        time.sleep(0.05)
    process.close()
    found = {item.name: item for item in items}
    assert found["tree: every leaf is known"].passed
    assert found["arms: home is clear"].passed
    assert found["controller: state"].detail == "no controller was named; give its address with --robot"
    assert found["grippers: position"].passed is None
    assert len(found) == len(items) == 17
