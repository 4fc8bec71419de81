"""Commands of the package as processes of their own, beside the page."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
from collections.abc import Callable, Sequence

from bt_jax._util.errors import UserError

__all__ = ["NICE", "last_words", "run_command"]

NICE = 10  # the page comes first on a busy machine
AT_ONCE = 2  # commands, whoever presses what how often

_running: set[object] = set()


async def run_command(
    module: str,
    words: Sequence[str],
    *,
    otherwise: str,
    say: Callable[[str], None] | None = None,
    interrupt: asyncio.Event | None = None,
) -> None:
    """Run python -m MODULE WORDS to its end, or until it ends as by Ctrl-C once `interrupt` is set; `say` hears each line
    that it prints. If it fails, raise UserError with the last line of its errors, or with `otherwise` if there is none. So
    many as `AT_ONCE` may run; one more is refused with a UserError."""
    if len(_running) >= AT_ONCE:
        raise UserError(f"{AT_ONCE} films or trials are being made already; wait until one is done")
    _running.add(mine := object())
    try:
        await _run(module, words, otherwise, say, interrupt)
    finally:
        _running.discard(mine)


async def _run(
    module: str,
    words: Sequence[str],
    otherwise: str,
    say: Callable[[str], None] | None,
    interrupt: asyncio.Event | None,
) -> None:
    process = await asyncio.create_subprocess_exec(
        *(sys.executable, "-u", "-m", module, *words),
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.DEVNULL if say is None else asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
        preexec_fn=lambda: os.nice(NICE),
    )
    waiting = None if interrupt is None else asyncio.create_task(_interrupt(process, interrupt))
    try:
        if say is None:
            _, said = await process.communicate()
        else:
            assert process.stderr is not None
            said, _ = await asyncio.gather(process.stderr.read(), _listen(process, say))
            await process.wait()
    except asyncio.CancelledError:
        process.kill()
        raise
    finally:
        if waiting is not None:
            waiting.cancel()
    if process.returncode:
        raise UserError(last_words(said) or otherwise)


async def _listen(process: asyncio.subprocess.Process, say: Callable[[str], None]) -> None:
    assert process.stdout is not None
    async for line in process.stdout:
        say(line.decode("utf-8", "replace").strip())


async def _interrupt(process: asyncio.subprocess.Process, interrupt: asyncio.Event) -> None:
    await interrupt.wait()
    with contextlib.suppress(ProcessLookupError):
        process.send_signal(signal.SIGINT)


def last_words(said: bytes) -> str:
    """Return the last line that a command has printed, as a sentence for the page."""
    lines = said.decode("utf-8", "replace").strip().splitlines()
    return lines[-1].removeprefix("error: ") if lines else ""
