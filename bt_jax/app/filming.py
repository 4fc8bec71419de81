"""Films of a run's best tree, made by `python -m bt_jax.run` in a process of its own."""

from __future__ import annotations

import asyncio
import os
import sys
from pathlib import Path

from bt_jax.errors import UserError

__all__ = ["film_run"]

NICE = 10  # the page comes first
_RUNNING: set[Path] = set()


async def film_run(run: Path) -> Path:
    """Films the best tree of a run folder, as `film.mp4` in there. Raises UserError where that fails, or is being done."""
    if run in _RUNNING:
        raise UserError(f"{run.name} is being filmed already; wait for that film")
    _RUNNING.add(run)
    part = run / ".part.film.mp4"
    try:
        await _film(run, part)
        return part.replace(run / "film.mp4")
    except OSError as error:
        raise UserError(f"the film cannot be kept ({error.strerror}); look at the folder {run}") from None
    finally:
        _RUNNING.discard(run)
        part.unlink(missing_ok=True)


async def _film(run: Path, film: Path) -> None:
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bt_jax.run", str(run), "--render", str(film), "--delay", "0",
        stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE, preexec_fn=lambda: os.nice(NICE),
    )  # fmt: skip
    _, said = await process.communicate()
    if process.returncode:
        lines = said.decode("utf-8", "replace").strip().splitlines() or ["the film could not be made; see the terminal"]
        raise UserError(lines[-1].removeprefix("error: "))
