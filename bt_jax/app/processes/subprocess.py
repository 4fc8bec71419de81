"""Commands of the package as processes of their own, beside the page."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Sequence

from bt_jax._util.errors import UserError

__all__ = ["NICE", "last_words", "run_command"]

NICE = 10  # the page comes first where a machine has too much to do


async def run_command(module: str, words: Sequence[str], *, otherwise: str) -> None:
    """Runs python -m MODULE WORDS to its end. Raises UserError with its last words where it fails, and with `otherwise`
    where it has said nothing."""
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
    """The last line of what a command has printed, as it would be said on the page."""
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].removeprefix("error: ") if lines else ""
