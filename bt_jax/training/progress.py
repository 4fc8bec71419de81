"""What a training tells other processes while it runs: `progress.json` in its run folder.

A lock on `training.lock` says whether a process trains there; it ends with the process, however that ends.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal

from bt_jax._util.decoding import decode
from bt_jax._util.errors import UserError
from bt_jax._util.files import try_lock, write_atomic
from bt_jax._util.json_files import read_json
from bt_jax.behaviors import Tree
from bt_jax.encoding.formats.text import one_line, parse_tree
from bt_jax.gp.evolution import Generation

__all__ = ["Progress", "Reporter", "Stage", "is_alive", "locked", "read_progress"]

Stage = Literal["starting", "evolving", "testing", "finished", "stopped", "failed"]
SECONDS = 0.2  # between two writings of generations, at least
LOCK = "training.lock"
ROWS = 500  # of the history that are kept, at most
LOCK_SECONDS = 1.0  # `is_alive` holds the lock for a moment


@dataclasses.dataclass(frozen=True)
class Progress:
    """Where a training is: fitness is the best over its runs, and the mean of their means; `episodes` are of all runs.

    `history` has rows of generation, best and mean; of long trainings, some hundreds evenly chosen, and the last.
    """

    pid: int
    stage: Stage = "starting"
    generation: int = 0
    generations: int = 0
    episodes: int = 0
    best: float | None = None
    mean: float | None = None
    tree: str = ""  # the best so far, on one line
    message: str = ""  # why it failed
    history: tuple[tuple[int, float, float], ...] = ()

    def with_history(self, rows: Sequence[Generation]) -> Progress:
        """Return this with all that follows from the history of a training: one row a generation and run, in their order."""
        if not rows:
            return self
        runs = rows[-1].run + 1
        history = tuple(
            (
                some[0].generation,
                round(max(row.best for row in some), 2),
                round(sum(row.mean for row in some) / runs, 2),
            )
            for some in (rows[i * runs : (i + 1) * runs] for i in _chosen(len(rows) // runs))
        )
        generation, best, mean = history[-1]
        episodes = sum(row.episodes for row in rows[-runs:])
        return dataclasses.replace(
            self, generation=generation, episodes=episodes, best=best, mean=mean, history=history
        )


class Reporter:
    """Writes the progress of this process into a run folder, as a listener of its run.

    What another process reported there before stays until there is news. A report that cannot be written is left out: the
    training goes on.
    """

    def __init__(self, folder: Path, generations: int) -> None:
        self._folder, self._written = folder, 0.0
        self._news: tuple[Sequence[Generation], Callable[[], Tree]] | None = None  # told, and not yet written
        known = read_progress(folder) or Progress(0)
        self._now = dataclasses.replace(known, pid=os.getpid(), stage="starting", generations=generations, message="")

    def on_stage(self, stage: Stage, message: str = "") -> None:
        """Write that another part of the work begins, or that the last has ended: a finished run has had all its
        generations."""
        self._now = dataclasses.replace(self._now, stage=stage, message=message)
        self._write()

    def on_generation(self, history: Sequence[Generation], best_tree: Callable[[], Tree]) -> None:
        """Write where the evolution is, five times a second at most."""
        first = self._now.stage == "evolving" and self._news is None
        self._news = history, best_tree
        if first or time.monotonic() - self._written >= SECONDS:
            self._write()

    def _write(self) -> None:
        self._written = time.monotonic()
        if self._news is not None:
            history, best_tree = self._news
            self._now = dataclasses.replace(self._now, tree=one_line(best_tree())).with_history(history)
        if self._now.stage == "finished":
            self._now = dataclasses.replace(self._now, generations=self._now.generation)
        with contextlib.suppress(UserError):
            write_atomic(self._folder / "progress.json", json.dumps(dataclasses.asdict(self._now)) + "\n")


def _chosen(count: int) -> list[int]:
    """Return numbers below `count`: all, or as many as are kept, the first and the last among them."""
    if count <= ROWS:
        return list(range(count))
    return [round(i * (count - 1) / (ROWS - 1)) for i in range(ROWS)]


def read_progress(folder: Path) -> Progress | None:
    """Return the progress of the training in a run folder; None if there is none, or none that can be read."""
    source = folder / "progress.json"
    try:
        progress = decode(read_json(source), Progress, source)
        if progress.tree:
            parse_tree(progress.tree)
    except UserError:
        return None
    return progress


def is_alive(folder: Path) -> bool:
    """Return whether a process is training in a run folder."""
    try:
        with open(folder / LOCK, "rb") as file:
            return not try_lock(file, shared=True)
    except OSError:
        return False


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep other processes from training in a run folder meanwhile. Raise UserError if one does already, or nothing can be
    written there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        lock = open(folder / LOCK, "wb")  # noqa: SIM115
    except OSError as error:
        raise UserError(
            f"{folder / LOCK} cannot be written ({error.strerror}); check who may write there, or copy the folder"
        ) from error
    began = time.monotonic()
    with lock as file:
        while not try_lock(file, shared=False):
            if time.monotonic() - began > LOCK_SECONDS:
                raise UserError(f"another process is training in {folder}; wait until it has ended, or stop it")
            time.sleep(0.02)
        yield
