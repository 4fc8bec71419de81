"""Films of a run's best tree, made by `python -m bt_jax.run` in a process of its own."""

from __future__ import annotations

from pathlib import Path

from bt_jax._util.errors import UserError
from bt_jax.app.processes.subprocess import run_command

__all__ = ["film_run"]

_RUNNING: set[Path] = set()


async def film_run(run: Path) -> Path:
    """Film the best tree of a run folder, as `film.mp4` in it. Raise UserError if that fails, or is being done already."""
    if run in _RUNNING:
        raise UserError(f"{run.name} is being filmed already; wait for that film")
    _RUNNING.add(run)
    part = run / ".part.film.mp4"
    try:
        words = [str(run), "--render", str(part), "--delay", "0"]
        await run_command("bt_jax.run", words, otherwise="the film could not be made; try again")
        return part.replace(run / "film.mp4")
    except OSError as error:
        raise UserError(f"the film cannot be kept ({error.strerror}); look at the folder {run}") from None
    finally:
        _RUNNING.discard(run)
        part.unlink(missing_ok=True)
