"""What every command does before it works: choose JAX's device, keep compiled code, report errors in one sentence."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Literal

from bt_jax._util.errors import UserError

__all__ = ["CompileClock", "Device", "configure_jax", "exit_code"]

Device = Literal["auto", "cpu", "gpu"]


def configure_jax(device: Device = "auto") -> None:
    """Select the device and keep compiled functions in `$BT_JAX_CACHE` or `~/.cache/bt_jax`.

    Only commands call this, since it changes settings of the whole process: in a program of yours they are yours.

    Raise UserError if a GPU is asked for and none is found.
    """
    import jax

    from bt_jax._util.compile_cache import keep_compiled

    if device != "auto":
        jax.config.update("jax_platforms", "cpu" if device == "cpu" else None)
    cache = Path(os.environ.get("BT_JAX_CACHE") or Path.home() / ".cache" / "bt_jax")
    keep_compiled(cache)
    jax.config.update("jax_enable_compilation_cache", False)  # it does not mix with `keep_compiled`
    if device == "gpu" and jax.default_backend() == "cpu":
        raise UserError('no GPU was found; use --device cpu, or on an NVIDIA machine pip install "bt_jax[cuda]"')


def exit_code(command: Callable[[], int | None]) -> int:
    """Run a command and return its exit code, 0 if it returns none; a UserError becomes one sentence on stderr and code 2,
    Ctrl-C code 130."""
    try:
        return command() or 0
    except UserError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1


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
