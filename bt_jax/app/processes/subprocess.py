"""Commands of the package as processes of their own, beside the page."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Sequence

from bt_jax._util.errors import UserError

__all__ = ["NICE", "last_words", "run_command"]

NICE = 10  # the page comes first on a busy machine
AT_ONCE = 2  # commands, whoever presses what how often

_running: set[object] = set()


async def run_command(module: str, words: Sequence[str], *, otherwise: str) -> None:
    """Run python -m MODULE WORDS to its end. If it fails, raise UserError with the last line that it printed, or with
    `otherwise` if it printed nothing. So many as `AT_ONCE` may run; one more is refused with a UserError."""
    if len(_running) >= AT_ONCE:
        raise UserError(f"{AT_ONCE} films or trials are being made already; wait until one is done")
    _running.add(mine := object())
    try:
        await _run(module, words, otherwise)
    finally:
        _running.discard(mine)


async def _run(module: str, words: Sequence[str], otherwise: str) -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", module, *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        preexec_fn=lambda: os.nice(NICE),
    )
    try:
        _, said = await process.communicate()
    except asyncio.CancelledError:
        process.kill()
        raise
    if process.returncode:
        raise UserError(last_words(said) or otherwise)


def last_words(said: bytes) -> str:
    """Return the last line that a command has printed, as a sentence for the page."""
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].removeprefix("error: ") if lines else ""
