import os
import signal
import subprocess
import sys
import time
from pathlib import Path

PARENT = """
import multiprocessing, os, time
from bt_jax._util.child_process import end_with_parent

def work(file):
    end_with_parent()
    with open(file, "w") as out:
        out.write(str(os.getpid()))
    time.sleep(600)

if __name__ == "__main__":
    child = multiprocessing.get_context("spawn").Process(target=work, args=(r"{file}",))
    child.start()
    child.join()
"""


def test_a_child_ends_when_its_parent_is_killed(tmp_path):
    script, file = tmp_path / "parent.py", tmp_path / "child"
    script.write_text(PARENT.format(file=file))
    parent = subprocess.Popen([sys.executable, str(script)])
    until(lambda: file.exists() and file.read_text())
    child = int(file.read_text())
    assert runs(child)
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    until(lambda: not runs(child))


def runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not stat.exists() or stat.read_text().rsplit(")", 1)[1].split()[0] != "Z"  # nobody may collect an orphan


def until(happened, seconds: float = 120.0) -> None:
    end = time.monotonic() + seconds
    while not happened():
        assert time.monotonic() < end
        time.sleep(0.05)
