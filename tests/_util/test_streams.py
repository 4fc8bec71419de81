"""What a command prints where stdout is not a terminal that can show everything."""

import io
import os
import subprocess
import sys

import pytest

from bt_jax._util.streams import prepare_streams

PRINTS = """
import sys
from rich.console import Console
from bt_jax._util.startup import exit_code

def command():
    for _ in range(3):
        Console(soft_wrap=True).print("→ ✓ ± Öl 箱")
    print("went on", file=sys.stderr)

sys.exit(exit_code(command))
"""


def printed(shell, **environment):
    words = ["sh", "-c", f'"$0" -c "$1" {shell}', sys.executable, PRINTS]
    return subprocess.run(words, capture_output=True, text=True, env=os.environ | environment)


@pytest.mark.parametrize(
    ("encoding", "line"),
    [("ascii", r"> + +- \xd6l \u7bb1"), ("cp1252", r"> + ± Öl \u7bb1"), ("utf-8", "→ ✓ ± Öl 箱")],
)
def test_what_an_encoding_lacks_becomes_ascii(monkeypatch, encoding, line):
    out = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr(sys, "stdout", out)
    prepare_streams()
    print("→ ✓ ± Öl 箱")
    out.flush()
    assert out.buffer.getvalue().decode(encoding) == line + "\n"


def test_a_process_with_an_encoding_of_its_own():
    done = printed("", PYTHONIOENCODING="ascii")
    assert (done.returncode, done.stdout) == (0, "> + +- \\xd6l \\u7bb1\n" * 3)


@pytest.mark.skipif(os.name != "posix", reason="a shell redirects")
@pytest.mark.parametrize(
    ("shell", "code", "said"),
    [
        (">&-", 0, "went on\n"),
        ("| true", 0, "went on\n"),
        (
            ">/dev/full",
            1,
            "warning: what this prints cannot be written (No space left on device); the command goes on\n",
        ),
    ],
)
def test_a_command_goes_on_where_its_output_ends_nowhere(shell, code, said):
    done = printed(f"{shell}; exit $?" if "|" not in shell else shell)
    assert (done.returncode, done.stdout) == (code, "")
    assert said in done.stderr
    assert "went on" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no full disk to write to")
def test_output_that_is_lost_leaves_no_file_open(monkeypatch):
    with open("/dev/full", "w", encoding="utf-8") as full:
        for name in ("stdout", "__stdout__"):
            monkeypatch.setattr(sys, name, full)
        prepare_streams()
        free = os.dup(full.fileno())
        os.close(free)
        print("x", flush=True)
        after = os.dup(full.fileno())
        os.close(after)
        assert after == free
