"""The start of a command: the device, and settings of the environment that must not change a result."""

import os
import subprocess
import sys

import pytest

from bt_jax._util.errors import UserError
from bt_jax._util.startup import exit_code

CONFIGURES = """
import sys
from pathlib import Path
from bt_jax._util.startup import configure_jax, exit_code

def command():
    configure_jax()
    import jax
    print(jax.numpy.zeros(1).dtype, jax.config.jax_disable_jit, jax.config.jax_debug_nans)

sys.exit(exit_code(command))
"""


IMPORTS = """
import sys
from bt_jax._util.startup import exit_code

def command():
    import mujoco

sys.exit(exit_code(command))
"""


def configured(**environment):
    known = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    return subprocess.run([sys.executable, "-c", CONFIGURES], capture_output=True, text=True, env=known | environment)


@pytest.mark.parametrize("platform", ["cuda", "nonsense"])
def test_a_platform_that_is_not_there_is_said_in_one_sentence(platform):
    done = configured(JAX_PLATFORMS=platform)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"error: JAX_PLATFORMS is {platform} and JAX finds no such device; unset it, use")
    assert done.stderr.count("\n") == 1


def test_no_device_at_all_is_not_laid_on_a_variable_that_is_not_set(monkeypatch):
    from bt_jax._util import startup

    def none():
        raise RuntimeError("no backend")

    monkeypatch.delenv("JAX_PLATFORMS", raising=False)
    monkeypatch.setattr("jax.default_backend", none)
    with pytest.raises(UserError, match="JAX finds no device; use --device cpu"):
        startup.configure_jax()


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(28, "No space left on device"), "the system refuses to read or write (No space left on device)"),
        (OSError(13, "Permission denied", "a.txt"), "a.txt cannot be used (Permission denied); check this path"),
    ],
)
def test_what_the_system_refuses_is_said_in_one_sentence(capsys, error, said):
    def refused():
        raise error

    assert exit_code(refused) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f"error: {said}")
    assert shown.count("\n") == 1


def test_a_renderer_that_mujoco_does_not_know_is_said_in_one_sentence():
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS], capture_output=True, text=True, env=os.environ | {"MUJOCO_GL": "nonsense"}
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "MUJOCO_GL: nonsense; unset it" in done.stderr


def test_options_of_jax_that_change_numbers_are_pinned_by_the_commands():
    done = configured(JAX_PLATFORMS="cpu", JAX_ENABLE_X64="1", JAX_DISABLE_JIT="1", JAX_DEBUG_NANS="1")
    assert (done.returncode, done.stdout) == (0, "float32 False False\n"), done.stderr


def test_a_user_without_a_home_keeps_no_compiled_code(monkeypatch):
    from bt_jax._util import startup

    def homeless():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("BT_JAX_CACHE", raising=False)
    monkeypatch.setattr(startup.Path, "home", homeless)
    startup.configure_jax()
