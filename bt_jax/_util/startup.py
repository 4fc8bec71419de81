"""What every command does before it works: choose JAX's device, keep compiled code, report errors in one sentence."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from bt_jax._util.errors import UserError
from bt_jax._util.streams import output_lost, prepare_streams

__all__ = ["CompileClock", "Device", "configure_jax", "exit_code"]

Device = Literal["auto", "cpu", "gpu"]

PINNED: dict[str, Any] = {
    "jax_enable_x64": False,
    "jax_default_matmul_precision": None,
    "jax_default_prng_impl": "threefry2x32",
    "jax_threefry_partitionable": True,
    "jax_random_seed_offset": 0,
    "jax_enable_custom_prng": False,
    "jax_high_dynamic_range_gumbel": False,
    "jax_platform_name": "",
    "jax_disable_jit": False,
    "jax_disable_most_optimizations": False,
    "jax_debug_nans": False,
    "jax_debug_infs": False,
}  # of JAX's options those that change numbers or stop a run; the environment sets them otherwise (JAX_ENABLE_X64, ...)
REMEDY = 'use --device cpu, or on an NVIDIA machine pip install "bt_jax[cuda]"'


def configure_jax(device: Device = "auto") -> None:
    """Select the device, pin the options that change numbers, keep compiled code in `$BT_JAX_CACHE` or `~/.cache/bt_jax`.

    Only commands call this, since it changes settings of the whole process: in a program of yours they are yours.

    Raise UserError if the device that is asked for, here or by `$JAX_PLATFORMS`, is not found.
    """
    import jax

    from bt_jax._util.compile_cache import keep_compiled

    for name, value in PINNED.items():
        jax.config.update(name, value)
    if device != "auto":
        jax.config.update("jax_platforms", "cpu" if device == "cpu" else None)
    cache = _cache_folder()
    if cache is not None:
        keep_compiled(cache)
    jax.config.update("jax_enable_compilation_cache", False)  # it does not mix with `keep_compiled`
    try:
        backend = jax.default_backend()
    except Exception as error:  # RuntimeError, or AssertionError for some platforms
        asked = os.environ.get("JAX_PLATFORMS")
        if asked is None:
            raise UserError(f"JAX finds no device; {REMEDY}") from error
        raise UserError(f"JAX_PLATFORMS is {asked} and JAX finds no such device; unset it, {REMEDY}") from error
    if device == "gpu" and backend == "cpu":
        raise UserError(f"no GPU was found; {REMEDY}")


def _cache_folder() -> Path | None:
    """Return where compiled functions are kept, None for a user without a home folder."""
    if named := os.environ.get("BT_JAX_CACHE"):
        return Path(named)
    try:
        return Path.home() / ".cache" / "bt_jax"
    except RuntimeError:
        return None


def exit_code(command: Callable[[], int | None]) -> int:
    """Run a command and return its exit code, 0 if it returns none; a UserError, or a file that the system refuses, becomes
    one sentence on stderr and code 2, Ctrl-C code 130, and output that could not be written makes it 1 at least."""
    prepare_streams()
    try:
        code = command() or 0
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except OSError as error:
        if error.errno is None:  # not from the system
            raise
        if error.filename is None:
            problem = f"the system refuses to read or write ({error.strerror}); check disks and connections"
        else:
            problem = f"{error.filename} cannot be used ({error.strerror}); check this path"
        print(f"error: {problem}", file=sys.stderr)
        code = 2
    except RuntimeError as error:
        if "MUJOCO_GL" not in str(error):  # which MuJoCo reads while it is imported
            raise
        print(f"error: {error}; unset it", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        code = 130
    return code or int(output_lost())


class CompileClock:
    """As a context, adds up the time that its thread spends on tracing, lowering and compiling (or loading compiled code),
    or on waiting for another thread that does."""

    EVENTS = (
        "jaxpr_trace_duration",
        "jaxpr_to_mlir_module_duration",
        "backend_compile_duration",
        "load_executable_duration",
        "wait_for_executable_duration",
    )

    seconds = 0.0

    def __enter__(self) -> CompileClock:
        from jax import monitoring  # heavy

        self._thread = threading.get_ident()
        monitoring.register_event_duration_secs_listener(self._add)
        return self

    def __exit__(self, *_: object) -> None:
        from jax import monitoring  # heavy

        monitoring.unregister_event_duration_listener(self._add)

    def _add(self, event: str, duration_secs: float, **_: str | int) -> None:
        if event.endswith(self.EVENTS) and threading.get_ident() == self._thread:
            self.seconds += duration_secs
