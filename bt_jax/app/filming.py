"""Films of a run's best tree, made by `python -m bt_jax.run` in a process of its own."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from bt_jax.errors import UserError

__all__ = ["film_run"]


async def film_run(run: Path, film: Path) -> None:
    """Films the best tree of a run folder. Raises UserError where that fails."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "bt_jax.run", str(run), "--render", str(film), "--delay", "0",
        stdout=asyncio.subprocess.DEVNULL, stderr=asyncio.subprocess.PIPE,
    )  # fmt: skip
    _, said = await process.communicate()
    if process.returncode:
        lines = said.decode("utf-8", "replace").strip().splitlines() or ["the film could not be made; see the terminal"]
        raise UserError(lines[-1].removeprefix("error: "))
