import subprocess
import sys

import pytest

from bt_jax._cli import COMMANDS


def bt_jax(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run([sys.executable, "-m", "bt_jax._cli", *words], capture_output=True, text=True)


def test_help_lists_the_commands_and_imports_nothing_heavy():
    shown = bt_jax("--help")
    assert shown.returncode == 0
    assert all(f"  {name} " in shown.stdout for name in COMMANDS)
    code = "import sys, bt_jax._cli; print(*(m for m in ('numpy', 'jax', 'mujoco', 'tyro') if m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.split() == []


def test_without_a_command_it_says_how_to_use_it():
    shown = bt_jax()
    assert (shown.returncode, shown.stdout) == (2, "")
    assert shown.stderr.startswith("usage: bt-jax COMMAND")


@pytest.mark.parametrize(
    ("words", "remedy"),
    [(("trian",), "did you mean train?"), (("qqq",), "choose one of train"), (("deploy", "twn"), "did you mean twin?")],
)
def test_an_unknown_command_is_named(words, remedy):
    shown = bt_jax(*words)
    assert (shown.returncode, shown.stdout, shown.stderr.count("\n")) == (2, "", 1)
    assert f"unknown command '{words[-1]}'; {remedy}" in shown.stderr


def test_a_command_gets_its_words_and_gives_its_exit_code(tmp_path):
    shown = bt_jax("run", str(tmp_path / "missing.txt"))
    assert shown.returncode == 2
    assert f"there is no file or folder {tmp_path / 'missing.txt'}" in shown.stderr
