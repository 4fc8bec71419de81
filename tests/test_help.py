"""`--help` answers at once: it imports nothing that only the work needs."""

import subprocess
import sys

import pytest

from bt_jax.tasks import task_names

HEAVY = ("jax", "mujoco", "sklearn", "scipy", "matplotlib", "cv2", "pinocchio", "nicegui")
DEPLOY = ("twin", "check", "run", "markers", "calibrate", "rapid", "rates", "replay")
COMMANDS = (
    "train",
    "learn",
    "run",
    "demonstrate",
    "check",
    "report",
    "app",
    "experiments",
    "deploy",
    *(f"deploy {one}" for one in DEPLOY),
)
SCRIPT = """
import runpy, sys
module, sys.argv[1:] = sys.argv[1], sys.argv[2:]
try:
    runpy.run_module(module, run_name="__main__", alter_sys=True)
except SystemExit as end:
    code = end.code or 0
print("imported", *sorted(sys.modules))
sys.exit(code)
"""


def run(*words):
    """What `python -m WORDS` printed, and the modules that it had imported when it ended."""
    command = [sys.executable, "-c", SCRIPT, *words]
    process = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert process.returncode == 0, process.stderr
    shown, _, modules = process.stdout.rpartition("imported ")
    return shown, set(modules.split())


def test_the_help_of_train_names_the_packaged_tasks():
    shown = " ".join(run("bt_jax.train", "--help")[0].replace("│", " ").split())
    for name in task_names():
        assert name.removeprefix("yumi_") in shown.replace("yumi_stack", "stack"), name


@pytest.mark.parametrize("command", COMMANDS)
def test_help_imports_nothing_heavy(command):
    name, *words = command.split()
    shown, modules = run(f"bt_jax.{name}", *words, "--help")
    assert "usage" in shown
    assert modules.isdisjoint(HEAVY)


def test_help_says_once_what_happens_without_an_option():
    shown, _ = run("bt_jax.demonstrate", "--help")
    assert "[-h] [OPTIONS] FOLDER [SCRIPT]" in shown
    assert "None" not in shown


@pytest.mark.parametrize("command", ["train", "run", "learn", "experiments"])
def test_help_shows_no_value_that_nobody_can_type(command):
    assert "None" not in run(f"bt_jax.{command}", "--help")[0]


def test_training_without_demonstrations_imports_neither_scikit_learn_nor_scipy():
    code = "import sys, bt_jax.commands.train; print(*sys.modules)"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert "bt_jax.lfd.learning" in found.stdout.split()
    assert {"sklearn", "scipy", "matplotlib", "imageio"}.isdisjoint(found.stdout.split())
